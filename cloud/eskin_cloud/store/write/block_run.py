"""Blocks of a batch that a node said of one channel in one boot: what they share is done once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from eskin_cloud.store.write.channels import add_blocks, require_row
from eskin_cloud.store.write.presence import note_blocks

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin.wire.messages import BlockSummary
    from eskin_cloud.store.write.block_row import BlockRow
    from eskin_cloud.store.write.stored_sequences import StoredSequences
    from eskin_cloud.store.write.write_cache import Row, WriteCache


@dataclass(slots=True)
class BlockRun:
    """Blocks that are to be stored.

    Attributes:
        node: Who said them.
        boot: In which of its boots.
        channel: Of which of its channels.
        ranges: What is stored of this boot; the cache's own.
        digests: By number, those that are added of this boot; the cache's own.
        known: The channel's row; nothing before the first block.
        rows: The blocks' rows, in the batch's order.
    """

    node: str
    boot: int
    channel: str
    ranges: StoredSequences
    digests: dict[int, bytes]
    known: Row = field(default_factory=dict)
    rows: list[BlockRow] = field(default_factory=list)

    @property
    def unit(self) -> str | None:
        """The channel's unit, as far as it is known."""
        return self.known.get("unit")

    def begin(self, connection: Connection, cache: WriteCache, block: BlockSummary) -> None:
        """Know the channel, before its first block: a batch shall not name two units for it."""
        self.known = require_row(connection, cache, self.node, block)

    def cursor(self) -> int:
        """The last block's place in the feed."""
        return self.rows[-1].cursor

    def settle(self, connection: Connection, cache: WriteCache, *, now: int) -> tuple[int, int]:
        """Add the blocks to what is known of node and channel; gives the last one's lag, ns."""
        cache.grow(self.node, self.boot)
        add_blocks(cache, self.known, self.rows)
        return note_blocks(connection, cache, self.rows, now=now)
