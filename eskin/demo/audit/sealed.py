"""Frames that the store holds sealed, opened by the site's keys: the audit may see all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_cloud.privacy.sealed_rows import open_row
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from sqlalchemy import func, select, tuple_

from eskin.errors import AuditError, NoKeyError, PrivacyError
from eskin.privacy import Decryptor, FileMasterKey, KeyStore
from eskin.privacy.cipher import span
from eskin.privacy.master_key import MASTER_FILE
from eskin.privacy.sealed_message import name_place
from eskin.wire.frames import EncodedFrame

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sqlalchemy import Connection, RowMapping

    from eskin.demo.layout import DemoFolder


def count_sealed(connection: Connection) -> dict[str, int]:
    """Sealed frames by node."""
    v = sealed_messages.c
    query = select(v.node, func.count()).where(v.kind == "frame").group_by(v.node)
    return {node: int(count) for node, count in connection.execute(query)}


def open_keys(layout: DemoFolder) -> Decryptor:
    """What opens the messages of the demo's site."""
    return Decryptor(KeyStore(layout.keys, FileMasterKey(layout.keys / MASTER_FILE)))


def sealed_rows(connection: Connection, node: str, most: int) -> Iterator[Sequence[RowMapping]]:
    """Rows of the node's sealed frames in order, so many in memory at most."""
    v, last = sealed_messages.c, (-1, -1)
    while True:
        query = select(sealed_messages).where(v.node == node, v.kind == "frame")
        query = query.where(tuple_(v.boot, v.sequence) > last).order_by(v.boot, v.sequence)
        rows = connection.execute(query.limit(most)).mappings().all()
        if not rows:
            return
        yield rows
        last = rows[-1]["boot"], rows[-1]["sequence"]


def open_frame(reader: Decryptor, row: RowMapping) -> EncodedFrame | None:
    """A sealed frame; ``None`` if it is damaged, or its subject was erased.

    Raises:
        AuditError: The site's keys cannot be read, or the row holds another message.
    """
    try:
        opened = open_row(reader, row)
    except NoKeyError:
        return None
    except PrivacyError as error:
        raise AuditError(f"a sealed frame cannot be read: {error}") from error
    if opened is None:
        return None
    frame, _ = opened
    if not isinstance(frame, EncodedFrame):
        raise AuditError(f"{row['node']} sealed another message as a frame: {frame.position}")
    return frame


def has_columns(row: RowMapping, frame: EncodedFrame) -> bool:
    """Whether the columns of a row are those of the frame in it."""
    place = name_place((frame.layout, frame.page))
    lo, hi = span(frame)
    same = (row["place"], row["boot"], row["sequence"]) == (place, *frame.position)
    return same and row["t_lo"] <= lo <= hi <= row["t_hi"]
