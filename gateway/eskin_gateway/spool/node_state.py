"""What the gateway remembers of one node: the memory behind *once*."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Self

import cbor2

from eskin.errors import MessageError, shown
from eskin.wire.messages import Position
from eskin.wire.messages.cbor_map import MOST_COUNT, integer, integer_pair, items
from eskin.wire.sequence_set import SequenceRanges

_MOST_BOOTS: Final = 16
_MOST_RANGES: Final = 4096
"""Of all boots: each commit writes them."""
_MOST_OLD_RANGES: Final = 64
"""Of a boot below ``held``."""


@dataclass(slots=True)
class NodeState:
    """What was accepted of a node, and what it still may send.

    It is bounded: what it forgets, and sees again, the cloud knows to be stored.

    Attributes:
        held: The lowest position that the node still holds, as it said; of this boot, nothing below
            comes again.
        ranges: Accepted sequences of each boot, the one used last behind the others; of the boot of
            ``held``, not below it.
        status: The node's latest status (plaintext), for the public topic.
        thumbprint: The certificate that it last used.
    """

    held: Position = field(default_factory=lambda: Position(0, 0))
    ranges: dict[int, SequenceRanges] = field(default_factory=dict)
    status: bytes | None = None
    thumbprint: bytes | None = None

    def seen(self, position: Position) -> bool:
        """Whether a position was accepted before, or lies below what the node still holds.

        A lower boot that is not known here is none that was accepted: the node may have lost its
        flash, and have a clock that was ahead when it began the one before.
        """
        if position.boot == self.held.boot and position < self.held:
            return True
        ranges = self.ranges.get(position.boot)
        return ranges is not None and position.sequence in ranges

    def add(self, position: Position) -> None:
        """Remember an accepted position."""
        ranges = self.ranges.get(position.boot)
        if ranges is None:
            ranges = self.ranges[position.boot] = SequenceRanges()
        elif next(reversed(self.ranges)) != position.boot:
            self.ranges[position.boot] = self.ranges.pop(position.boot)
        ranges.add(position.sequence)

    def release(self, held: Position | None) -> None:
        """Take over the lowest position that the node still holds; it never goes back."""
        if held is None or held <= self.held:
            return
        if held.boot > self.held.boot:
            self._close(held.boot)
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

    def _close(self, boot: int) -> None:
        """The node holds nothing of the boots before: whatever they left open, it was somewhere."""
        if self.held.sequence:
            self.add(Position(self.held.boot, self.held.sequence - 1))
        for old in [known for known in self.ranges if known < boot]:
            last = max(last for _, last in self.ranges[old])
            self.ranges[old] = SequenceRanges([(0, last)])

    def _cut(self) -> None:
        boot, sequence = self.held.boot, self.held.sequence
        for forgotten in list(self.ranges)[:-_MOST_BOOTS]:
            del self.ranges[forgotten]
        room = _MOST_RANGES
        for known in list(reversed(self.ranges)):
            kept, most = self.ranges[known], min(room, _MOST_OLD_RANGES) if known < boot else room
            if not most:
                del self.ranges[known]
            elif len(kept) > most:
                self.ranges[known] = SequenceRanges(list(kept)[-most:])
            room -= min(len(kept), most)
        ranges = self.ranges.get(boot)
        if ranges is not None and any(first < sequence for first, _ in ranges):
            self.ranges[boot] = SequenceRanges(
                (max(first, sequence), last) for first, last in ranges if last >= sequence
            )
