"""Exponential smoothing of a tube: ``y_k = w·y_(k-1) + (1 - w)·x_k``, from the first sample on.

The bounds enclose the smoothed truth, not the truth: peaks are sought in them, blocks never hold
them. A sample with an unbounded side starts it anew.
"""

from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.inversion import Buffer


class Smoothing:
    """The filter's state.

    Args:
        weight: Weight w of the past, ``0 <= w < 1``.

    Attributes:
        lo: Lower bound of the past.
        hi: Upper bound of the past.
        fresh: Whether there is no past.
    """

    __slots__ = ("fresh", "hi", "lo", "weight")

    def __init__(self, weight: float) -> None:
        self.weight = weight
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self.lo = self.hi = 0.0
        self.fresh = True

    def smooth(self, lows: "Buffer", highs: "Buffer", n: int) -> None:
        """Replace n bounds by smoothed ones."""
        past, present = self.weight, 1.0 - self.weight
        for k in range(n):
            lo, hi = lows[k], highs[k]
            if lo == -INFINITY or hi == INFINITY:
                self.fresh = True
                continue
            if not self.fresh:
                lo = down(lo * (down(present) if lo >= 0.0 else up(present)))
                hi = up(hi * (up(present) if hi >= 0.0 else down(present)))
                lo, hi = down(down(past * self.lo) + lo), up(up(past * self.hi) + hi)
            self.lo, self.hi, self.fresh = lo, hi, False
            lows[k], highs[k] = lo, hi
