"""A block's row; a tuple, because there are many."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Self

from eskin_cloud.store.damage import RowHeader

if TYPE_CHECKING:
    from eskin.wire.messages import BlockSummary


class BlockRow(NamedTuple):
    """The columns of `eskin_cloud.store.schema.tables.blocks`, in their order."""

    node: str
    boot: int
    sequence: int
    cursor: int
    channel: str
    t: int
    t_end: int
    error: int
    t_lo: int
    t_hi: int
    dt: int
    n: int
    lo: float
    hi: float
    coverage: float
    received: int
    data: bytes
    digest: bytes
    packed: int | None
    head: int | None

    @classmethod
    def of(
        cls, node: str, block: BlockSummary, data: bytes, digest: bytes, cursor: int, now: int
    ) -> Self:
        """The row of a block.

        Args:
            node: The node.
            block: The decoded block.
            data: Its stored bytes.
            digest: Digest of ``data``.
            cursor: Its cursor in the feed.
            now: UTC ns.
        """
        (boot, sequence), channel, _, (t_lo, t_hi), dt, n, _, coverage, _, _, (lo, hi) = block
        first = (t_lo + t_hi) // 2
        last, error = first + dt * (n - 1), (t_hi - t_lo + 1) // 2
        head = RowHeader(node, channel, boot, sequence, first, last, error, t_lo, t_hi, dt,
                    n, lo, hi, coverage, None, digest)  # fmt: skip
        return cls(node, boot, sequence, cursor, channel, first, last, error, t_lo, t_hi, dt,
                   n, lo, hi, coverage, now, data, digest, None, head.checksum())  # fmt: skip
