"""What a channel is like when nothing touches: calibrated, then followed as it drifts.

Drift compensation must not learn a touch that stays (icub-main#55 did). So the baseline follows
only frames which *certainly* stay near it: a sustained contact is possibly or certainly away, is
never followed, and never fades.
"""

from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

PACE = 1.0 / 64
"""Share of the way to a frame's mean that the baseline goes with each frame."""


class Baseline:
    """Bounds of a channel's mean at rest.

    Attributes:
        lo: Lower bound, in the channel's unit.
        hi: Upper bound.
        known: Whether it was ever calibrated.
    """

    __slots__ = ("hi", "known", "lo")

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Go back to before the first calibration."""
        self.lo = self.hi = 0.0
        self.known = False

    def calibrate(self, lows: "Sequence[float]", highs: "Sequence[float]", n: int) -> bool:
        """Take n samples as the rest; refused where a side of one is unbounded."""
        lo, hi = mean_bounds(lows, highs, n)
        self.known = hi - lo < INFINITY
        if self.known:
            self.lo, self.hi = lo, hi
        return self.known

    def scale(self, ratio: "tuple[float, float]") -> None:
        """Take what is measured from now on as greater by a positive ratio."""
        lo, hi = self.lo, self.hi
        self.lo = down(lo * (ratio[0] if lo >= 0.0 else ratio[1]))
        self.hi = up(hi * (ratio[1] if hi >= 0.0 else ratio[0]))

    def track(
        self, lows: "Sequence[float]", highs: "Sequence[float]", n: int, threshold: float
    ) -> bool:
        """Whether n samples are certainly nearer to the rest than a threshold; then follow them."""
        if not self.known:
            return False
        least, most = self.hi - threshold, self.lo + threshold
        for k in range(n):
            if lows[k] < least or highs[k] > most:
                return False
        lo, hi = mean_bounds(lows, highs, n)
        self.lo += PACE * (lo - self.lo)
        self.hi += PACE * (hi - self.hi)
        return True


def mean_bounds(lows: "Sequence[float]", highs: "Sequence[float]", n: int) -> "tuple[float, float]":
    """An enclosure of the mean of n samples."""
    lo = hi = 0.0
    for k in range(n):
        lo, hi = down(lo + lows[k]), up(hi + highs[k])
    return down(lo / n), up(hi / n)
