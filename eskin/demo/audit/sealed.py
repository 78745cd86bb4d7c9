"""What the store holds sealed, opened by the site's keys: the audit may see all."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin_cloud.privacy.sealed_rows import open_row
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from sqlalchemy import func, select

from eskin.errors import AuditError, NoKeyError, PrivacyError
from eskin.privacy import Decryptor, FileMasterKey, KeyStore
from eskin.privacy.cipher import span
from eskin.privacy.master_key import MASTER_FILE
from eskin.wire.messages import Block, Position

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection, RowMapping

    from eskin.demo.layout import Layout

_PAGE: Final = 500


def count_sealed(connection: Connection) -> dict[str, int]:
    """Sealed blocks by node."""
    query = select(sealed_messages.c.node, func.count()).where(sealed_messages.c.kind == "block")
    rows = connection.execute(
        query.group_by(sealed_messages.c.node).order_by(sealed_messages.c.node)
    )
    return {row[0]: int(row[1]) for row in rows}


def sealed_positions(connection: Connection, node: str) -> Iterator[tuple[int, int]]:
    """Boot and sequence of a node's sealed blocks, in order."""
    query = select(sealed_messages.c.boot, sealed_messages.c.sequence)
    query = query.where(sealed_messages.c.node == node, sealed_messages.c.kind == "block")
    yield from connection.execute(
        query.order_by(sealed_messages.c.boot, sealed_messages.c.sequence)
    )


def sealed_pages(
    layout: Layout, connection: Connection, node: str
) -> Iterator[list[tuple[Block, bool]]]:
    """The node's sealed blocks, and whether their columns enclose them; erased ones are left out.

    Raises:
        AuditError: The site's keys cannot be read.
    """
    reader = Decryptor(KeyStore(layout.keys, FileMasterKey(layout.keys / MASTER_FILE)))
    last = Position(-1, -1)
    v = sealed_messages.c
    while True:
        beyond = (v.boot > last.boot) | ((v.boot == last.boot) & (v.sequence > last.sequence))
        query = select(sealed_messages).where(v.node == node, v.kind == "block", beyond)
        rows = connection.execute(query.order_by(v.boot, v.sequence).limit(_PAGE)).mappings().all()
        if not rows:
            return
        yield [found for row in rows if (found := _open(reader, row)) is not None]
        last = Position(rows[-1]["boot"], rows[-1]["sequence"])


def _open(reader: Decryptor, row: RowMapping) -> tuple[Block, bool] | None:
    try:
        opened = open_row(reader, row)
    except NoKeyError:
        return None
    except PrivacyError as error:
        raise AuditError(f"a sealed block cannot be read: {error}") from error
    if opened is None:
        return None  # damaged, and collected
    block, _ = opened
    if not isinstance(block, Block):
        raise AuditError(f"{row['node']} sealed another message as a block: {block.position}")
    lo, hi = span(block)
    claimed = (row["place"], row["boot"], row["sequence"])
    same = claimed == (block.channel, block.position.boot, block.position.sequence)
    return block, same and row["t_lo"] <= lo <= hi <= row["t_hi"]
