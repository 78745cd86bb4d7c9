"""The state of each node that makes delivery exactly once."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

import cbor2

from eskin.errors import MessageError, shown
from eskin.wire.messages import Position
from eskin.wire.messages.cbor_map import MOST_COUNT, integer, integer_pair, items
from eskin.wire.sequence_set import SequenceRanges

if TYPE_CHECKING:
    from eskin_gateway.spool.spool import Spool

_MAX_BOOTS: Final = 16
_MAX_RANGES: Final = 4096
"""Of all boots: each commit writes them."""
_MAX_OLD_RANGES: Final = 64
"""Of a boot below ``held``."""


@dataclass(slots=True)
class NodeState:
    """Which messages of a node were accepted, and what it last sent of itself.

    It is bounded. The cloud drops duplicates that it no longer knows.

    Attributes:
        held: The lowest position that the node still holds, as it reported. No message of this boot
            below it is sent again.
        ranges: Accepted sequences of each boot, the boot used last at the end. Those of the boot of
            ``held`` begin at ``held``.
        status: The node's latest status (plaintext), for the public topic.
        thumbprint: Thumbprint of the certificate that it used last.
    """

    held: Position = field(default_factory=lambda: Position(0, 0))
    ranges: dict[int, SequenceRanges] = field(default_factory=dict)
    status: bytes | None = None
    thumbprint: bytes | None = None

    def is_duplicate(self, position: Position) -> bool:
        """Whether a position was accepted before, or lies below what the node still holds.

        An unknown lower boot is new: the node may have lost its flash, and its clock may have been
        ahead when it began the boot before.
        """
        if position.boot == self.held.boot and position < self.held:
            return True
        ranges = self.ranges.get(position.boot)
        return ranges is not None and position.sequence in ranges

    def add(self, position: Position) -> None:
        """Add an accepted position."""
        ranges = self.ranges.get(position.boot)
        if ranges is None:
            ranges = self.ranges[position.boot] = SequenceRanges()
        elif next(reversed(self.ranges)) != position.boot:
            self.ranges[position.boot] = self.ranges.pop(position.boot)
        ranges.add(position.sequence)

    def release(self, held: Position | None) -> None:
        """Advance the lowest position that the node still holds. It never decreases."""
        if held is None or held <= self.held:
            return
        if held.boot > self.held.boot:
            self._close_boots(held.boot)
        self.held = held

    def encode_ranges(self) -> bytes:
        """Encode the ranges, without sequences below ``held``."""
        self._trim()
        ranges = {boot: [list(r) for r in ranges] for boot, ranges in self.ranges.items()}
        return cbor2.dumps(ranges)

    @classmethod
    def restore(
        cls, held: Position, ranges: bytes, status: bytes | None, thumbprint: bytes | None
    ) -> Self:
        """Decode what `encode_ranges` encoded.

        Raises:
            MessageError: The ranges are invalid.
        """
        try:
            decoded = cbor2.loads(ranges)
        except (cbor2.CBORError, ValueError, TypeError, ArithmeticError, RuntimeError) as error:
            raise MessageError(f"ranges are no CBOR: {error}") from error
        if not isinstance(decoded, dict):
            raise MessageError(f"ranges are {shown(decoded)}; expected a map")
        by_boot = {
            integer(boot, "boot", 0, MOST_COUNT): SequenceRanges(
                integer_pair(span, "span", 0, MOST_COUNT)
                for span in items(spans, "spans", len(ranges))
            )
            for boot, spans in decoded.items()
        }
        return cls(held, by_boot, status, thumbprint)

    def _close_boots(self, boot: int) -> None:
        """Mark all of earlier boots as accepted: the node no longer holds any of it."""
        if self.held.sequence:
            self.add(Position(self.held.boot, self.held.sequence - 1))
        for old in [known for known in self.ranges if known < boot]:
            last = max(last for _, last in self.ranges[old])
            self.ranges[old] = SequenceRanges([(0, last)])

    def _trim(self) -> None:
        boot, sequence = self.held.boot, self.held.sequence
        for oldest in list(self.ranges)[:-_MAX_BOOTS]:
            del self.ranges[oldest]
        room = _MAX_RANGES
        for known in list(reversed(self.ranges)):
            ranges, most = self.ranges[known], min(room, _MAX_OLD_RANGES) if known < boot else room
            if not most:
                del self.ranges[known]
            elif len(ranges) > most:
                self.ranges[known] = SequenceRanges(list(ranges)[-most:])
            room -= min(len(ranges), most)
        current = self.ranges.get(boot)
        if current is not None and any(first < sequence for first, _ in current):
            self.ranges[boot] = SequenceRanges(
                (max(first, sequence), last) for first, last in current if last >= sequence
            )


class NodeStates:
    """States by node, read from the spool on first use.

    Args:
        spool: Where they are durable.
        capacity: Most states in memory between batches.
    """

    def __init__(self, spool: Spool, *, capacity: int = 4096) -> None:
        self._spool = spool
        self._capacity = capacity
        self._states: OrderedDict[str, NodeState] = OrderedDict()

    def __getitem__(self, node: str) -> NodeState:
        state = self._states.get(node)
        if state is None:
            state = self._states[node] = self._spool.node(node) or NodeState()
        return state

    def committed(self, nodes: dict[str, NodeState]) -> None:
        """Drop the least recently used states after a commit."""
        for node in nodes:
            self._states.move_to_end(node)
        while len(self._states) > self._capacity:
            self._states.popitem(last=False)

    def reset(self) -> None:
        """Drop all states after a failed commit: they may hold positions that are not durable."""
        self._states.clear()
