"""Which taxels are stuck or dead, from what they measured: three answers, in constant memory.

Over a window of samples a tube shows two things for certain: how far its quantity moved at least
(``max lo - min hi``), and how far it can have moved at most (``max hi - min lo``). A contact does
not leave out a taxel in its middle, nor does the air: one that stays still while all around it
move is stuck. One of which no sample in a window is bounded lies outside of its converter's range:
its line is open.
"""

from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

IMPOSSIBLE = 0
POSSIBLE = 1
CERTAIN = 2
STILL = 0.5
"""A stuck one's bounds stray by this share of their width at most: noise and steps of the code."""


class BoundsWindow:
    """What one taxel's bounds did.

    Attributes:
        bounded: How many samples were bounded on both sides.
        unbounded: How many were not.
        width: The greatest width of a bounded one.
    """

    __slots__ = ("_hi", "_lo", "bounded", "unbounded", "width")

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Forget all samples."""
        self.bounded = self.unbounded = 0
        self.width = 0.0
        self._lo = (INFINITY, -INFINITY)
        self._hi = (INFINITY, -INFINITY)

    def take(self, lows: "Sequence[float]", highs: "Sequence[float]", n: int) -> None:
        """Take n samples in."""
        for k in range(n):
            lo, hi = lows[k], highs[k]
            if lo == -INFINITY or hi == INFINITY:
                self.unbounded += 1
                continue
            self.bounded += 1
            self.width = max(self.width, up(hi - lo))
            self._lo = min(self._lo[0], lo), max(self._lo[1], lo)
            self._hi = min(self._hi[0], hi), max(self._hi[1], hi)

    @property
    def dead(self) -> int:
        """Certain where no sample was bounded, possible where some were not."""
        if self.unbounded == 0:
            return IMPOSSIBLE
        return POSSIBLE if self.bounded else CERTAIN

    @property
    def moved(self) -> "tuple[float, float]":
        """Bounds of the range of the true values."""
        if self.bounded == 0:
            return 0.0, INFINITY
        most = INFINITY if self.unbounded else up(self._hi[1] - self._lo[0])
        return max(0.0, down(self._lo[1] - self._hi[0])), most

    @property
    def still(self) -> bool:
        """Whether its bounds stayed where they were, but for noise."""
        return self.moved[1] <= (1.0 + STILL) * self.width

    @property
    def lively(self) -> bool:
        """Whether it certainly moved, and by more than its own width."""
        return self.moved[0] > self.width


class SelfTest:
    """Examines the taxels of a node window by window.

    Args:
        neighbours: Of each taxel, the numbers of those around it; one without any is never
            certainly stuck.
    """

    def __init__(self, neighbours: "Sequence[Sequence[int]]") -> None:
        self._neighbours = neighbours
        self._windows = [BoundsWindow() for _ in neighbours]

    def take(self, taxel: int, lows: "Sequence[float]", highs: "Sequence[float]", n: int) -> None:
        """Take samples of one quantity of a taxel, always of the same one."""
        self._windows[taxel].take(lows, highs, n)

    def examine(self) -> "list[tuple[int, int]]":
        """For each taxel whether it is dead and whether it is stuck; then a new window begins."""
        found = [(window.dead, self._stuck(k)) for k, window in enumerate(self._windows)]
        for window in self._windows:
            window.begin()
        return found

    def _stuck(self, taxel: int) -> int:
        """Certain where it stayed while all of its living neighbours moved; there must be one."""
        own = self._windows[taxel]
        if own.moved[0] > 0.0:
            return IMPOSSIBLE
        around = [self._windows[k] for k in self._neighbours[taxel]]
        living = [window for window in around if window.bounded > 0]
        lively = [window for window in living if window.lively]
        if own.bounded > 0 and own.still and living and len(lively) == len(living):
            return CERTAIN
        return POSSIBLE
