"""What the gateway remembers of one node: the memory behind *once*."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import cbor2

from eskin.errors import MessageError, shown
from eskin.messages import Position
from eskin.messages.fields import MOST_COUNT, integer, integer_pair, items
from eskin.sequences import SequenceRanges


@dataclass(slots=True)
class NodeRecord:
    """What was accepted of a node, and what it still may send.

    Attributes:
        held: The lowest position that the node still holds, as it said; nothing below comes again.
        ranges: Accepted sequences of each boot, not below ``held``.
        status: The node's latest status (plaintext), for the public topic.
        thumbprint: The certificate that it last used.
    """

    held: Position = field(default_factory=lambda: Position(0, 0))
    ranges: dict[int, SequenceRanges] = field(default_factory=dict)
    status: bytes | None = None
    thumbprint: bytes | None = None

    def seen(self, position: Position) -> bool:
        """Whether a position was accepted before, or lies below what the node still holds."""
        if position < self.held:
            return True
        ranges = self.ranges.get(position.boot)
        return ranges is not None and position.sequence in ranges

    def add(self, position: Position) -> None:
        """Remember an accepted position."""
        ranges = self.ranges.get(position.boot)
        if ranges is None:
            ranges = self.ranges[position.boot] = SequenceRanges()
        ranges.add(position.sequence)

    def release(self, held: Position | None) -> None:
        """Take over the lowest position that the node still holds; it never goes back."""
        if held is not None and held > self.held:
            self.held = held

    def encode_ranges(self) -> bytes:
        """Write the ranges, without what lies below ``held``."""
        self._cut()
        return cbor2.dumps({boot: [list(r) for r in kept] for boot, kept in self.ranges.items()})

    @classmethod
    def restore(
        cls, held: Position, ranges: bytes, status: bytes | None, thumbprint: bytes | None
    ) -> Self:
        """Read what `encode_ranges` wrote.

        Raises:
            MessageError: It is something else.
        """
        try:
            decoded = cbor2.loads(ranges)
        except (cbor2.CBORError, ValueError, TypeError, ArithmeticError, RuntimeError) as error:
            raise MessageError(f"ranges are no CBOR: {error}") from error
        if not isinstance(decoded, dict):
            raise MessageError(f"ranges are {shown(decoded)}; expected a map")
        kept = {
            integer(boot, "boot", 0, MOST_COUNT): SequenceRanges(
                integer_pair(span, "span", 0, MOST_COUNT)
                for span in items(spans, "spans", len(ranges))
            )
            for boot, spans in decoded.items()
        }
        return cls(held, kept, status, thumbprint)

    def _cut(self) -> None:
        boot, sequence = self.held.boot, self.held.sequence
        for old in [known for known in self.ranges if known < boot]:
            del self.ranges[old]
        ranges = self.ranges.get(boot)
        if ranges is not None and any(first < sequence for first, _ in ranges):
            self.ranges[boot] = SequenceRanges(
                (max(first, sequence), last) for first, last in ranges if last >= sequence
            )
