"""Messages under way: handed to the radio, not yet acknowledged."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.chip import Position


class InFlightWindow:
    """Remembers what is under way, and since when.

    Args:
        size: Messages that may be under way at once.
        patience: Time from leaving the radio until a message counts as late; the unit is the
            caller's.
    """

    __slots__ = ("_left", "_patience", "_quiet_until", "_size")

    def __init__(self, size: int, patience: int) -> None:
        self._size = size
        self._patience = patience
        # None: the radio still has it, and would only get it twice.
        self._left: dict[Position, int | None] = {}
        # Nothing is late before.
        self._quiet_until: int | None = None

    @property
    def room(self) -> int:
        """How many more may go."""
        return self._size - len(self._left)

    def __contains__(self, position: "Position") -> bool:
        return position in self._left

    def hand_over(self, position: "Position") -> None:
        """The radio has it now."""
        self._left[position] = None

    def note_sent(self, position: "Position", now: int) -> None:
        """The radio is rid of it, sent or not."""
        if position in self._left:
            self._left[position] = now
            if self._quiet_until is None:
                self._quiet_until = now + self._patience

    def late(self, now: int) -> "list[Position]":
        """What went out too long ago, oldest message first."""
        if self._quiet_until is None or now <= self._quiet_until:
            return []
        late = []
        first = None
        for position, left in self._left.items():
            if left is None:
                continue
            if now - left > self._patience:
                late.append(position)
            elif first is None or left < first:
                first = left
        if not late:
            self._quiet_until = None if first is None else first + self._patience
        return sorted(late)

    def forget(self, position: "Position") -> None:
        """It is gone."""
        self._left.pop(position, None)

    def named(self, spans: "Sequence[tuple[int, int, int]]") -> "list[Position]":
        """What is under way of all that ``(boot, first, last)`` name."""
        found = []
        for boot, first, last in spans:
            found += [p for p in self._left if p[0] == boot and first <= p[1] <= last]
        return found

    def acknowledge(self, spans: "Sequence[tuple[int, int, int]]") -> None:
        """Forget what ``(boot, first, last)`` name."""
        for position in self.named(spans):
            self.forget(position)

    def clear(self) -> None:
        """Nothing is under way: the radio has lost its connection."""
        self._left = {}
        self._quiet_until = None
