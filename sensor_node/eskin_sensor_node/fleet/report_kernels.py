"""What thousands of nodes report of one taxel's samples: which are sent, and peaks; compiled."""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.peaks.certain_possible_peaks import search
from eskin_sensor_node.fleet.baseline_kernels import forget, is_due, smooth
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.fleet.columns import Columns

    Integers = NDArray[np.int64]

PEAK: Final = np.dtype(
    [
        *((name, np.int64) for name in ("row", "patch", "column", "earliest", "latest")),
        *((name, np.int64) for name in ("verdict", "fewest", "most")),
        *((name, np.float64) for name in ("height_inf", "height_sup")),
        *((name, np.float64) for name in ("prominence_inf", "prominence_sup", "coverage")),
    ]
)
"""One peak: the node's row, and what its statement says."""
GONE: Final = -1
"""In the place of a node that has left its group: it reports nothing."""
_up: Final = compiled_inversion().up
_down: Final = compiled_inversion().down


class Timing(NamedTuple):
    """A schedule and a clock's bounds, as `firmware.schedule` and `firmware.clock` have them."""

    origin: int
    dt: int
    burst: int
    pause: int
    error: int
    drift: int


class TaxelDesign(NamedTuple):
    """What all nodes share of a taxel.

    Attributes:
        patches: Of each channel, the number of its patch.
        columns: Of each channel, its column there.
        prominences: Least prominence of each channel's peaks; 0 where there are none.
        coverage: Of one sample.
        mode: What is sent: a place in `eskin_sensor_node.fleet.baseline_kernels.MODES`.
        smoothing: Weight of the past in the samples in which peaks are sought; 0: none.
        timing: When samples are taken, and how well the nodes know it.
    """

    patches: Integers
    columns: Integers
    prominences: Floats
    coverage: float
    mode: int
    smoothing: float
    timing: Timing


class Nodes(NamedTuple):
    """Some nodes.

    Attributes:
        readings: What they know of UTC at tick 0, ns.
        boots: Their boots.
        sequences: Their next sequences.
    """

    readings: Integers
    boots: Integers
    sequences: Integers


class Group(NamedTuple):
    """Nodes that sample together.

    Attributes:
        nodes: All nodes that started together.
        numbers: Which of them it has, a row each; `GONE` where one has left.
    """

    nodes: Nodes
    numbers: Integers


@part
def _ticks_of(timing: Timing, sample: int) -> int:
    """When a sample is taken."""
    if timing.burst == 0:
        return timing.origin + sample * timing.dt
    number, inside = sample // timing.burst, sample % timing.burst
    return timing.origin + number * timing.pause + inside * timing.dt


@part
def error_at(error: int, drift: int, ticks: int) -> int:
    """Greatest error of the clock; the product of both would not fit into 64 bits after days."""
    seconds, rest = ticks // BILLION, ticks % BILLION
    return error + seconds * drift - (-rest * drift) // BILLION


@part
def _coverage(coverage: float, samples: int) -> float:
    """Probability that so many samples hold at once, at least."""
    if coverage == 1.0:
        return 1.0
    least: float = max(0.0, _down(1.0 - _up(samples * (1.0 - coverage))))
    return least


@part
def _seek(
    lows: Floats,
    highs: Floats,
    row: int,
    k: int,
    design: TaxelDesign,
    group: Group,
    columns: Columns,
    peaks: Any,
    count: int,
    events: Any,
) -> int:
    """Seek peaks in some samples of one channel; gives how many there are by now."""
    progress = columns.progress[k, row : row + 1]
    passes, regions = columns.passes[k, row], columns.regions[k, row]
    _, found = search(lows, highs, design.prominences[k], progress, passes, regions, events)
    since, timing = columns.rests[k, row].since, design.timing
    reading = group.nodes.readings[group.numbers[row]]
    for number in range(found):
        event, peak = events[number], peaks[count]
        first, last = _ticks_of(timing, event.first), _ticks_of(timing, event.last)
        peak.row, peak.patch, peak.column = row, design.patches[k], design.columns[k]
        peak.earliest = reading + first - error_at(timing.error, timing.drift, first)
        peak.latest = reading + last + error_at(timing.error, timing.drift, last)
        peak.verdict, peak.fewest, peak.most = event.verdict, event.fewest, event.most
        peak.height_inf, peak.height_sup = event.height_inf, event.height_sup
        peak.prominence_inf, peak.prominence_sup = event.prominence_inf, event.prominence_sup
        samples = event.last - (since if design.smoothing > 0.0 else event.first) + 1
        peak.coverage = _coverage(design.coverage, samples)
        count += 1
    return count


@part
def _pause(
    samples: int,
    row: int,
    k: int,
    design: TaxelDesign,
    group: Group,
    columns: Columns,
    peaks: Any,
    count: int,
    events: Any,
) -> int:
    """Join nothing across some missing samples, or none; takes the peaks that stay undecided."""
    if design.prominences[k] > 0.0:
        missing = np.full(1, nan)
        count = _seek(missing, missing, row, k, design, group, columns, peaks, count, events)
        columns.progress[k, row].index += samples - 1
    return count


@kernel
def report(
    closes: bool,  # noqa: FBT001 - compiled
    lows: Floats,
    highs: Floats,
    design: TaxelDesign,
    group: Group,
    columns: Columns,
    sent: NDArray[np.bool_],
    peaks: Any,
    events: Any,
) -> int:
    """Take one frame of all nodes, node by node in their order.

    Args:
        closes: Whether sampling pauses after it.
        lows: Lower bounds, channels × nodes × samples; smoothed afterwards, if they are to be.
        highs: Upper bounds.
        design: What all nodes share.
        group: Which nodes.
        columns: What the nodes remember.
        sent: Takes which samples are sent, channels × nodes.
        peaks: Takes the decided peaks.
        events: Room for the peaks of one piece.

    Returns:
        How many peaks.
    """
    count = 0
    for row in range(lows.shape[1]):
        if group.numbers[row] == GONE:
            continue
        for k in range(lows.shape[0]):
            lo, hi = lows[k, row], highs[k, row]
            threshold, rest = design.prominences[k], columns.rests[k, row]
            sent[k, row] = is_due(lo, hi, threshold, design.mode, rest)
            if threshold > 0.0:
                if design.smoothing > 0.0:
                    smooth(lo, hi, design.smoothing, rest)
                count = _seek(lo, hi, row, k, design, group, columns, peaks, count, events)
            if closes:
                count = _pause(0, row, k, design, group, columns, peaks, count, events)
    return count


@kernel
def skip(
    samples: int, design: TaxelDesign, group: Group, columns: Columns, peaks: Any, events: Any
) -> int:
    """Skip missing samples; takes the peaks that stay undecided. Else as `report`."""
    count = 0
    for row in range(group.numbers.size):
        if group.numbers[row] == GONE:
            continue
        for k in range(design.prominences.size):
            count = _pause(samples, row, k, design, group, columns, peaks, count, events)
            forget(columns.rests[k, row], columns.progress[k, row].index)
    return count
