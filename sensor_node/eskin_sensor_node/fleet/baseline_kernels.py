"""A channel's rest, and smoothing, compiled: twins of the firmware's `baseline` and `smoothing`."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any, Final

from eskin.kernels.jit import part
from eskin_sensor_node.firmware.channel import ADAPTIVE, HEARTBEAT, PACE, PEAKS, SAMPLES
from eskin_sensor_node.machine.compilation import compiled_inversion

if TYPE_CHECKING:
    from eskin.interval import Floats

MODES: Final = (SAMPLES, PEAKS, ADAPTIVE)
"""A mode's number is its place."""
_SAMPLES: Final = MODES.index(SAMPLES)
_ADAPTIVE: Final = MODES.index(ADAPTIVE)
_up: Final = compiled_inversion().up
_down: Final = compiled_inversion().down


@part
def mean_bounds(lows: Floats, highs: Floats) -> tuple[float, float]:
    """An enclosure of the mean of some samples."""
    lo = hi = 0.0
    for k in range(lows.size):
        lo, hi = _down(lo + lows[k]), _up(hi + highs[k])
    return _down(lo / lows.size), _up(hi / lows.size)


@part
def calibrate(lows: Floats, highs: Floats, rest: Any) -> None:
    """Take a frame as the rest, unless a side of it is unbounded."""
    lo, hi = mean_bounds(lows, highs)
    if hi - lo < inf:
        rest.lo, rest.hi, rest.known, rest.calibrating = lo, hi, 1, 0
    else:
        rest.known = 0


@part
def track(lows: Floats, highs: Floats, threshold: float, rest: Any) -> bool:
    """Whether a frame is certainly nearer to the rest than a threshold; then follow it."""
    if rest.known == 0:
        return False
    least, most = rest.hi - threshold, rest.lo + threshold
    for k in range(lows.size):
        if lows[k] < least or highs[k] > most:
            return False
    lo, hi = mean_bounds(lows, highs)
    rest.lo += PACE * (lo - rest.lo)
    rest.hi += PACE * (hi - rest.hi)
    return True


@part
def is_due(lows: Floats, highs: Floats, threshold: float, mode: int, rest: Any) -> bool:
    """Return whether the samples of a frame are sent, as `firmware.channel` does."""
    if rest.calibrating != 0:
        calibrate(lows, highs, rest)
    at_rest = track(lows, highs, threshold, rest)
    if mode != _ADAPTIVE:
        return mode == _SAMPLES
    rest.silent = rest.silent + 1 if at_rest and rest.silent + 1 < HEARTBEAT else 0
    silent: int = rest.silent
    return silent == 0


@part
def smooth(lows: Floats, highs: Floats, weight: float, rest: Any) -> None:
    """Replace bounds by smoothed ones."""
    present = 1.0 - weight
    less, more = _down(present), _up(present)
    for k in range(lows.size):
        lo, hi = lows[k], highs[k]
        if lo == -inf or hi == inf:
            rest.fresh = 1
            continue
        if rest.fresh == 0:
            lo = _down(lo * (less if lo >= 0.0 else more))
            hi = _up(hi * (more if hi >= 0.0 else less))
            lo = _down(_down(weight * rest.past_lo) + lo)
            hi = _up(_up(weight * rest.past_hi) + hi)
        rest.past_lo, rest.past_hi, rest.fresh = lo, hi, 0
        lows[k], highs[k] = lo, hi


@part
def forget(rest: Any, index: int) -> None:
    """Smoothing begins anew, with the sample of a number."""
    rest.past_lo = rest.past_hi = 0.0
    rest.fresh, rest.since = 1, index
