"""A sequence of gestures that unlocks: certain ones only, in order, with few attempts.

A gesture is a monitor's formula. At each sampled instant it is impossible, possible or certain.
The *word* that is entered has the gestures that hold, one after the other; one that holds again
before another one counts once. It is known while at most one gesture is possible at each instant,
and each one that was possible has been certain. Else the entry is unclear, and begins again after
a rest, an instant at which none is possible.
"""

from eskin_sensor_node.firmware.monitor import CERTAIN, IMPOSSIBLE

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

IDLE = 0
WAITING = 1
COMPLETE = 2
RELEASED = 3
WRONG = 4
EXPIRED = 5
"""What became of the latest challenge; one that is complete is judged next."""


class GestureLock:
    """Takes entries, and counts those that are wrong.

    Args:
        gestures: Names of the monitors that can be entered.
        sequence: Those that unlock, in order; none follows itself.
        timeout: For an entry, ns.
        attempts: Wrong entries in a row after which it locks.
        lockout: How long it stays locked, ns.

    Attributes:
        outcome: Of the latest challenge.
        failures: Entries in a row that did not unlock, and those that are not judged.
        unclear: How often the entry began again since the challenge.
        changed: Whether any of these changed since the caller cleared it.
    """

    def __init__(
        self,
        gestures: "Sequence[str]",
        sequence: "Sequence[str]",
        *,
        timeout: int,
        attempts: int,
        lockout: int,
    ) -> None:
        self.gestures = gestures
        self._sequence = list(sequence)
        self._timeout = timeout
        self._attempts = attempts
        self._lockout = lockout
        self.outcome = IDLE
        self.failures = self.unclear = 0
        self.changed = False
        self._deadline = self._until = 0
        self._entered: list[str] = []
        self._open = ""
        self._sure = self._rested = False
        self._begin()

    def restore(self, failures: int, now: int) -> None:
        """Continue with what was counted before a start; a time of waiting begins again."""
        self.failures = failures
        self._lock(now)

    def locked(self, now: int) -> int:
        """For how many ns it takes no challenge."""
        return max(0, self._until - now)

    def challenge(self, now: int) -> None:
        """Await an entry from now on; it must not be locked."""
        self.outcome, self.unclear = WAITING, 0
        self._deadline = now + self._timeout
        self._begin()

    def take(self, now: int, verdicts: "Mapping[str, int]") -> None:
        """Take the verdicts of all gestures at an instant."""
        if self.outcome != WAITING:
            return
        if now >= self._deadline:
            self._expire(now)
            return
        there = [name for name in self.gestures if verdicts[name] != IMPOSSIBLE]
        if not self._rested:
            self._rested = not there
            return
        name = there[0] if there else ""
        if len(there) > 1 or (name != self._open and not self._sure):
            self._begin()
            self._rested = not there
            self.unclear += 1
            self.changed = True
            return
        if name != self._open:
            # One that is possible after it was certain is the same one.
            self._open, self._sure = name, not name or self._entered[-1:] == [name]
        if name and verdicts[name] == CERTAIN and not self._sure:
            self._sure = True
            self._entered.append(name)
            if len(self._entered) == len(self._sequence):
                # It is counted before it is judged: a cut of the power undoes no attempt.
                self.outcome, self.changed = COMPLETE, True
                self.failures += 1

    def judge(self, now: int) -> None:
        """Judge a complete entry, once its count is stored."""
        if self._entered == self._sequence:
            self.outcome, self.failures = RELEASED, 0
        else:
            self.refuse(now)
        self._begin()

    def refuse(self, now: int) -> None:
        """Let a complete entry be wrong."""
        self.outcome = WRONG
        self._lock(now)

    def _expire(self, now: int) -> None:
        self.outcome, self.changed = EXPIRED, True
        if self._entered:
            self.failures += 1
            self._lock(now)
        self._begin()

    def _lock(self, now: int) -> None:
        if self.failures >= self._attempts:
            self._until = now + self._lockout

    def _begin(self) -> None:
        self._entered = []
        self._open = ""
        self._sure = True
        self._rested = False
