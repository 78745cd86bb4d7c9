"""Sealed messages around a window, decrypted into a store in memory that answers all questions.

So there is one way to answer a question, whether the channel is sealed or not. What is decrypted
lies in memory alone, for as long as the question takes.
"""

from __future__ import annotations

import sqlite3
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final, NamedTuple

from sqlalchemy import create_engine, func, insert, select
from sqlalchemy.pool import StaticPool

from eskin.errors import MessageError, NoKeyError, QueryError
from eskin.privacy.sealed_message import name_place
from eskin.runtime.digest import digest
from eskin.wire.frames import EncodedFrame
from eskin.wire.slot import slot_of
from eskin_cloud.privacy.key_access import ErasedError
from eskin_cloud.privacy.sealed_rows import open_row
from eskin_cloud.store.frame_row import FrameRow, fit_frame
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.patch_runs import find_patch_pages
from eskin_cloud.store.read.window import Window, before
from eskin_cloud.store.row_digests import register_checksum
from eskin_cloud.store.schema.frame_tables import (
    descriptions,
    frames,
    pages,
    patch_rows,
    patch_tiles,
    patches,
    stale_patch_chunks,
)
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from eskin_cloud.store.schema.tables import feed, metadata, nodes
from eskin_cloud.store.write.bulk_insert import bulk_insert
from eskin_cloud.store.write.pages import add_frames
from eskin_cloud.store.write.write_cache import WriteCache

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sqlalchemy import Connection, RowMapping

    from eskin.privacy.cipher import Sealable
    from eskin.wire.frames import DescribedLayout
    from eskin_cloud.privacy.sealed_rows import SealedReader
    from eskin_cloud.store.read.lookup import Channel

MOST: Final = 20_000
"""Most sealed frames that are decrypted for one question."""
MOST_BYTES: Final = 64 << 20
"""Most bytes of them."""
_TABLES: Final = [
    *(nodes, feed, descriptions, pages, frames),
    *(patches, patch_rows, patch_tiles, stale_patch_chunks),
]


class SealedPage(NamedTuple):
    """A page whose frames are sealed.

    Attributes:
        described: The layout.
        page: Number of the page.
    """

    described: DescribedLayout
    page: int


@contextmanager
def decrypted_window(
    connection: Connection, reader: SealedReader, channel: Channel, window: Window
) -> Iterator[tuple[Connection, Channel]]:
    """A store in memory with a channel's frames around a window, and the channel there.

    Args:
        connection: Reads the store on the disk.
        reader: Opens what is sealed.
        channel: The channel on the disk.
        window: What is asked for.

    Raises:
        ErasedError: All of it is of erased subjects.
        QueryError: There is too much to open at once.
        PrivacyError: Something was changed on the disk, or its key is not here.
    """
    node = channel["node"]
    places = [
        SealedPage(each.described, each.page)
        for each in find_patch_pages(connection, node, channel["patch"])
    ]
    with decrypted_frames(connection, reader, node, places, window) as memory:
        yield memory, find_channel(memory, node, channel["channel"])


@contextmanager
def decrypted_frames(
    connection: Connection,
    reader: SealedReader,
    node: str,
    places: Sequence[SealedPage],
    window: Window,
) -> Iterator[Connection]:
    """A store in memory with frames of pages around a window; arguments as `decrypted_window`.

    Raises:
        ErasedError: All of it is of erased subjects.
        QueryError: There is too much to open at once.
        PrivacyError: Something was changed on the disk, or its key is not here.
    """
    rows: list[RowMapping] = []
    described_by: dict[str, DescribedLayout] = {}
    for described, page in dict.fromkeys(places):
        name = name_place((described.hash, page))
        described_by[described.hash.hex()] = described
        # Columns may be sampled later than their frame's minutes say.
        skew = int(described.facts[:, 3].max())
        wide = Window(before(window.start, skew), window.end)
        rows += _sealed(connection, node, name, wide)
        _require_few(rows)
    found: list[FrameRow] = []
    for row, message, data in _open(reader, rows):
        if isinstance(message, EncodedFrame):
            described = described_by[message.layout.hex()]
            try:
                fitting = fit_frame(message, described)
            except MessageError as error:
                raise QueryError("channel", str(error)) from error
            found.append(
                FrameRow.of(*(node, message, fitting, digest(data)), cursor=row["cursor"], now=0)
            )
    with _memory() as memory:
        _fill(memory, connection, node, list(described_by.values()), found)
        yield memory


@contextmanager
def _memory() -> Iterator[Connection]:
    engine = create_engine(
        "sqlite://", poolclass=StaticPool, connect_args={"check_same_thread": False}
    )
    try:
        with engine.begin() as memory:
            memory.exec_driver_sql("PRAGMA temp_store=MEMORY")  # a sort must not go to the disk
            driver = memory.connection.driver_connection
            assert isinstance(driver, sqlite3.Connection)  # noqa: S101 - as it was made
            register_checksum(driver)
            metadata.create_all(memory, _TABLES)
            yield memory
    finally:
        engine.dispose()


def _sealed(connection: Connection, node: str, place: str, window: Window) -> Sequence[RowMapping]:
    v = sealed_messages.c
    here = (
        of_node(sealed_messages, node)
        & (v.place == place)
        & (v.kind == "frame")
        & (v.t_lo < window.end)
        & (v.t_hi >= window.start)
    )
    size = select(func.sum(func.length(v.data))).where(here)
    if (connection.execute(size).scalar_one() or 0) > MOST_BYTES:
        raise QueryError("start", f"to end are over {MOST_BYTES} sealed bytes; ask for less")
    query = select(v.node, v.boot, v.sequence, v.cursor, v.data).where(here)
    query = query.order_by(v.t_lo, v.cursor).limit(MOST + 1)
    found = connection.execute(query).mappings().all()
    _require_few(found)
    return found


def _require_few(rows: Sequence[RowMapping]) -> None:
    if len(rows) > MOST:
        raise QueryError("start", f"to end are over {MOST} sealed messages; ask for less")
    if sum(len(row["data"]) for row in rows) > MOST_BYTES:
        raise QueryError("start", f"to end are over {MOST_BYTES} sealed bytes; ask for less")


def _open(
    reader: SealedReader, sealed: Sequence[RowMapping]
) -> list[tuple[RowMapping, Sealable, bytes]]:
    """What can be opened; the rest is missing, as a gap is."""
    found: list[tuple[RowMapping, Sealable, bytes]] = []
    lost: NoKeyError | None = None
    for row in sealed:
        try:
            opened = open_row(reader, row)
        except NoKeyError as error:
            lost = error
            continue
        if opened is not None:
            found.append((row, *opened))
    if lost is not None and not found:
        raise ErasedError(lost)
    return found


def _fill(
    memory: Connection,
    connection: Connection,
    node: str,
    layouts: Sequence[DescribedLayout],
    found: Sequence[FrameRow],
) -> None:
    """Insert frames, and all by which they are found and read."""
    row = connection.execute(select(nodes).where(of_node(nodes, node))).mappings().one()
    memory.execute(insert(nodes), dict(row))
    d = descriptions.c
    names = {name for each in layouts for name in (each.hash, *each.layout.patches)}
    latest = row["layout"]
    names |= set() if latest is None else {bytes(latest)}
    query = select(descriptions).where(of_node(descriptions, node), d.hash.in_(names))
    described = [dict(each) for each in connection.execute(query).mappings()]
    if described:
        memory.execute(insert(descriptions), described)
    slot = slot_of(node)
    memory.execute(insert(feed).values(slot=slot, cursor=slot, compacted=slot))
    cache, inserted = WriteCache(), bulk_insert(memory, frames)
    cache.lock(memory, [slot])
    of_pages: dict[tuple[bytes, int], list[FrameRow]] = {}
    for each in found:
        of_pages.setdefault((each.layout, each.page), []).append(each)
        inserted.add(each)
    inserted.finish()
    for of_page in of_pages.values():
        add_frames(memory, cache, of_page)
    cache.save(memory)
