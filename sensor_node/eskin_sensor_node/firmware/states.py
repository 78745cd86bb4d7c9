"""The firmware's state machine."""

BOOT = "boot"
RUN = "run"
SLEEP = "sleep"
SHED = "shed"
HALT = "halt"
"""Starting; working off a frame; in deep sleep until the next sample; sampling given up; failed."""

STARTED = "started"
IDLE = "idle"
DUE = "due"
SCARCE = "energy is scarce"
ORDERED = "ordered"
RESUMED = "resumed"
FAILED = "failed"

TRANSITIONS = {
    (BOOT, STARTED): SLEEP,
    (SLEEP, DUE): RUN,
    (RUN, IDLE): SLEEP,
    (RUN, FAILED): HALT,
    (SLEEP, SCARCE): SHED,
    (SLEEP, ORDERED): SHED,
    (SHED, RESUMED): SLEEP,
}
"""State and cause to the next state; anything else is a defect. Only a reset leads out of HALT."""


class StateMachine:
    """The state of the firmware, from one boot to the next.

    Attributes:
        state: One of the states above.
        cause: What led to it.
    """

    __slots__ = ("_since", "_spent", "cause", "state")

    def __init__(self) -> None:
        self.state = BOOT
        self.cause = ""
        self._since = 0
        self._spent = {BOOT: 0, RUN: 0, SLEEP: 0, SHED: 0, HALT: 0}

    def take(self, cause: str, ticks: int) -> None:
        """Go where a cause leads.

        Args:
            cause: One of the causes above.
            ticks: ns since the start.

        Raises:
            ValueError: It leads nowhere from here.
        """
        following = TRANSITIONS.get((self.state, cause))
        if following is None:
            raise ValueError("no way out of " + self.state + " for " + cause)
        self._spent[self.state] += ticks - self._since
        self._since = ticks
        self.state = following
        self.cause = cause

    def spent(self, state: str, ticks: int) -> int:
        """Ns in a state until now."""
        return self._spent[state] + (ticks - self._since if state == self.state else 0)
