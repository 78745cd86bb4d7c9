"""Aggregate the runs of a patch, all columns at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eskin.wire.frames.sample_codec import MOST_STRIDE, finest_exponent
from eskin_cloud.rollup.aggregates import EMPTY, Aggregates
from eskin_cloud.rollup.column_aggregates import ColumnAggregates, chained

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.frames import Patch
    from eskin_cloud.rollup.aggregates import Integers
    from eskin_cloud.rollup.blocks import Buckets
    from eskin_cloud.store.patch_run import PatchRun


class _Samples(NamedTuple):
    """Where the samples of a column stand in a window, an entry a run with any.

    Attributes:
        runs: As `fold_samples` takes them.
        begun: Time of the whole run's first sample.
        coverage: Of each run.
        cells: Which rows are samples; ``None`` where all are.
    """

    runs: Integers
    begun: Integers
    coverage: Floats
    cells: Integers | None


def fold_runs(runs: Sequence[PatchRun], patch: Patch, buckets: Buckets) -> ColumnAggregates:
    """One entry for each column and bucket with samples.

    Args:
        runs: With this description, in order of time, boot and sequence.
        patch: The description by which they are read.
        buckets: Samples outside of them are left out.
    """
    columns = len(patch.taxels)
    lo, hi = (
        np.ascontiguousarray(np.concatenate([getattr(run, side) for run in runs]).T)
        for side in ("lo", "hi")
    )
    strides = np.array([list(run.strides or bytes(columns)) for run in runs])
    alike: dict[tuple[bytes, int], _Samples] = {}
    found = []
    for column in range(columns):
        skew = patch.skew[column] if patch.skew else 0
        key = strides[:, column].tobytes(), skew
        if key not in alike:
            alike[key] = _locate(runs, 1 << strides[:, column], skew, buckets)
        pieces = _fold(alike[key], (lo[column], hi[column]), buckets)
        found.append(pieces)
    number = np.repeat(np.arange(columns), [len(pieces) for pieces in found])
    finest = finest_exponent(patch.least_width)
    return ColumnAggregates(columns, finest, number, chained(found))


def _locate(runs: Sequence[PatchRun], steps: Integers, skew: int, buckets: Buckets) -> _Samples:
    rows = np.array([run.lo.shape[0] for run in runs])
    numbers = np.array([(run.t, run.dt, run.first_row % 2**MOST_STRIDE, run.error) for run in runs])
    coverage = np.array([run.coverage for run in runs])
    window = buckets.window
    first = -numbers[:, 2] % steps
    t, dt = numbers[:, 0] + first * numbers[:, 1] + skew, numbers[:, 1] * steps
    n = -((first - rows) // steps)
    begin = np.maximum(0, -((t - window.start) // dt))
    end = np.minimum(n, (window.end - 1 - t) // dt + 1)
    here = begin < end
    place, n = np.cumsum(rows) - rows + first + begin * steps, end - begin
    cells = None
    if np.any(steps > 1):  # samples do not follow each other
        cells = _series(place[here], steps[here], n[here])
        place = np.cumsum(np.where(here, n, 0)) - n
    of_runs = np.stack([t + begin * dt, dt, n, place, numbers[:, 3]], axis=1)[here]
    return _Samples(np.ascontiguousarray(of_runs), t[here], coverage[here], cells)


def _fold(samples: _Samples, bounds: tuple[Floats, Floats], buckets: Buckets) -> Aggregates:
    """Aggregate one column."""
    runs, begun, coverage, cells = samples
    if not len(runs):
        return EMPTY
    if cells is not None:
        bounds = bounds[0][cells], bounds[1][cells]
    t, dt, n, place, error = runs.T
    if not np.any(t[1:] < (t + dt * (n - 1))[:-1]):
        grid = buckets.start, buckets.width
        return Aggregates.of_samples(bounds, runs, coverage, grid, buckets.count)
    # Runs overlap: sample by sample, in order of time and of the runs' starts.
    moments, rows = _series(t, dt, n), _series(place, np.ones_like(n), n)
    none = np.zeros(moments.size, np.int64)
    lo, hi = bounds[0][rows], bounds[1][rows]
    dts, errors = np.repeat(dt, n), np.repeat(error, n)
    each = Aggregates(
        *(moments, moments, none + 1, none, dts, none, errors),
        *(lo, hi, lo, hi, np.repeat(coverage, n)),
    )
    each = each[np.lexsort((np.repeat(begun, n), moments))]
    return each.grouped(buckets.of(each.first))


def _series(first: Integers, step: Integers, n: Integers) -> NDArray[np.int64]:
    """Numbers from a first one on in even steps, of all runs one after the other."""
    within = np.arange(n.sum()) - np.repeat(np.cumsum(n) - n, n)
    return np.asarray(np.repeat(first, n) + np.repeat(step, n) * within)
