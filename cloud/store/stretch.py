"""Blocks of a batch that a node said of one channel in one boot: what they share is done once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from cloud.store.channels import add_blocks, require_row
from cloud.store.presence import note_blocks

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from cloud.store.ledger import Ledger, Row
    from cloud.store.numbers import StoredNumbers
    from eskin.messages import BlockSummary


@dataclass(slots=True)
class Stretch:
    """Blocks that are to be stored.

    Attributes:
        node: Who said them.
        boot: In which of its boots.
        channel: Of which of its channels.
        ranges: What is stored of this boot; the ledger's own.
        known: The channel's row; nothing before the first block.
        rows: The blocks' rows, in the batch's order.
    """

    node: str
    boot: int
    channel: str
    ranges: StoredNumbers
    known: Row = field(default_factory=dict)
    rows: list[Row] = field(default_factory=list)

    @property
    def unit(self) -> str | None:
        """The channel's unit, as far as it is known."""
        return self.known.get("unit")

    def begin(self, connection: Connection, ledger: Ledger, block: BlockSummary) -> None:
        """Know the channel, before its first block: a batch shall not name two units for it."""
        self.known = require_row(connection, ledger, self.node, block)

    def cursor(self) -> int:
        """The last block's place in the feed."""
        return int(self.rows[-1]["cursor"])

    def settle(self, connection: Connection, ledger: Ledger, *, now: int) -> tuple[int, int]:
        """Add the blocks to what is known of node and channel; gives the last one's lag, ns."""
        ledger.grow(self.node, self.boot)
        add_blocks(ledger, self.known, self.rows)
        return note_blocks(connection, ledger, self.rows, now=now)
