"""A sealed channel's window, opened into a store in memory, of which all questions are asked.

So there is one way to answer a question, whether the channel is sealed or not; and what is opened
lies in memory alone, for as long as the question takes.
"""

from __future__ import annotations

import sqlite3
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from sqlalchemy import create_engine, insert, select
from sqlalchemy.pool import StaticPool

from eskin.errors import NoKeyError, QueryError
from eskin.runtime.digest import digest
from eskin.wire.messages import Block, BlockSummary
from eskin_cloud.privacy.errors import ErasedError
from eskin_cloud.privacy.sealed_rows import open_row
from eskin_cloud.store.row_digests import register_checksum
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from eskin_cloud.store.schema.tables import (
    blocks,
    channels,
    digests,
    events,
    feed,
    metadata,
    nodes,
    sequences,
)
from eskin_cloud.store.schema.tile_tables import stale_chunks, tiles
from eskin_cloud.store.write.ingest import ingest
from eskin_cloud.store.write.parsed_message import ParsedMessage
from eskin_cloud.store.write.write_cache import WriteCache

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sqlalchemy import Connection, Engine, RowMapping

    from eskin_cloud.privacy.sealed_rows import Reader
    from eskin_cloud.store.read.lookup import Channel
    from eskin_cloud.store.read.window import Window

MOST: Final = 20_000
"""Most sealed blocks that are opened for one question."""
_TABLES: Final = [nodes, channels, blocks, events, sequences, digests, feed, tiles, stale_chunks]


@contextmanager
def decrypted_window(
    connection: Connection, reader: Reader, channel: Channel, window: Window
) -> Iterator[tuple[Connection, Channel]]:
    """A store in memory with a channel's blocks around a window, and the channel's row there.

    Args:
        connection: Reads the store on the disk.
        reader: Opens what is sealed.
        channel: The channel's row on the disk.
        window: What is asked for.

    Raises:
        ErasedError: All of it is of erased subjects.
        QueryError: There is too much to open at once.
        PrivacyError: Something was changed on the disk, or its key is not here.
    """
    items = _open(reader, channel["node"], _sealed(connection, channel, window))
    engine = _engine()
    try:
        with engine.begin() as memory:
            _fill(memory, channel, items)
            yield memory, memory.execute(select(channels)).mappings().one()
    finally:
        engine.dispose()


def _sealed(connection: Connection, channel: Channel, window: Window) -> Sequence[RowMapping]:
    v = sealed_messages.c
    query = select(v.node, v.boot, v.sequence, v.data).where(
        v.node == channel["node"],
        v.channel == channel["channel"],
        v.kind == "block",
        v.t_lo < window.end,
        v.t_hi >= window.start,
    )
    found = connection.execute(query.order_by(v.t_lo, v.cursor).limit(MOST + 1)).mappings().all()
    if len(found) > MOST:
        raise QueryError("start", f"to end are over {MOST} sealed blocks; ask for less")
    return found


def _open(reader: Reader, node: str, sealed: Sequence[RowMapping]) -> list[ParsedMessage]:
    """What can be opened; the rest is missing, as a gap is."""
    items: list[ParsedMessage] = []
    lost: NoKeyError | None = None
    for row in sealed:
        try:
            opened = open_row(reader, row)
        except NoKeyError as error:
            lost = error
            continue
        if opened is None:
            continue
        message, plaintext = opened
        said = message.summary if isinstance(message, Block) else message
        items.append(ParsedMessage(node, plaintext, said, digest=digest(plaintext)))
    if lost is not None and not items:
        raise ErasedError(lost)
    return items


def _engine() -> Engine:
    return create_engine(
        "sqlite://", poolclass=StaticPool, connect_args={"check_same_thread": False}
    )


def _fill(memory: Connection, channel: Channel, items: Sequence[ParsedMessage]) -> None:
    memory.exec_driver_sql("PRAGMA temp_store=MEMORY")  # a large sort must not go to the disk
    driver = memory.connection.driver_connection
    assert isinstance(driver, sqlite3.Connection)  # noqa: S101 - as `_engine` makes it
    register_checksum(driver)
    metadata.create_all(memory, _TABLES)
    memory.execute(insert(feed).values(name="feed", cursor=0))
    first = items[0].message if items else None
    unit = first.unit if isinstance(first, BlockSummary) else channel["unit"]
    empty = {"unit": unit, "blocks": 0, "samples": 0, "longest": 0, "bytes": 0}
    empty |= dict.fromkeys(("t_first", "t_last", "grain", "built", "packed"))
    memory.execute(insert(channels), dict(channel) | empty)
    cache = WriteCache()
    outcome = ingest(memory, cache, items, gateway="", now=0, dead_letters=0)
    cache.save(memory)
    refused = [receipt.reason for receipt in outcome.results if receipt.reason is not None]
    if refused:
        raise QueryError("channel", refused[0])
