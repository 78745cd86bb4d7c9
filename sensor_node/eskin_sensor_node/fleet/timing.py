"""When samples are taken, and how well nodes know it, compiled."""

from __future__ import annotations

from typing import Final, NamedTuple

from eskin.kernels.jit import part

_BILLION: Final = 1_000_000_000


class Timing(NamedTuple):
    """A schedule and a clock's bounds, as `firmware.schedule` and `firmware.clock` have them."""

    origin: int
    dt: int
    burst: int
    pause: int
    error: int
    drift: int


@part
def ticks_of(timing: Timing, sample: int) -> int:
    """When a sample is taken."""
    if timing.burst == 0:
        return timing.origin + sample * timing.dt
    number, inside = sample // timing.burst, sample % timing.burst
    return timing.origin + number * timing.pause + inside * timing.dt


@part
def error_at(timing: Timing, ticks: int) -> int:
    """Greatest error of the clock; the product of both would not fit into 64 bits after days."""
    seconds, rest = ticks // _BILLION, ticks % _BILLION
    return timing.error + seconds * timing.drift - (-rest * timing.drift) // _BILLION
