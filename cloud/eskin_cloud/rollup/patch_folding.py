"""Aggregate the runs of a patch, all columns at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eskin.wire.frames.sample_codec import MOST_STRIDE, finest_exponent
from eskin_cloud.rollup.aggregates import EMPTY, Aggregates
from eskin_cloud.rollup.column_aggregates import ColumnAggregates, chained, united

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.frames import Patch
    from eskin_cloud.rollup.aggregates import Integers
    from eskin_cloud.rollup.buckets import Buckets
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


def fold_runs(
    runs: Sequence[PatchRun], patches: Mapping[bytes, Patch], buckets: Buckets
) -> ColumnAggregates:
    """One entry for each column and bucket with samples.

    Args:
        runs: Runs of a patch, at least one.
        patches: The descriptions by which they are read, by hash.
        buckets: Samples outside of them are left out.
    """
    names = tuple(dict.fromkeys(run.patch for run in runs))
    taxels = united(patches[name].taxels for name in names)
    table = _tabulate(runs, {name: patches[name] for name in names}, taxels)
    found, alike = [], dict[bytes, _Samples]()
    for column in range(len(taxels)):
        key = table.steps[:, column].tobytes() + table.skew[:, column].tobytes()
        if key not in alike:
            alike[key] = _locate(table, column, buckets)
        found.append(_fold(alike[key], (table.lo[column], table.hi[column]), buckets))
    return ColumnAggregates(
        names=names,
        taxels=taxels,
        finest=min(finest_exponent(patches[name].least_width) for name in names),
        column=np.repeat(np.arange(len(taxels)), [len(pieces) for pieces in found]),
        pieces=chained(found),
    )


class _Table(NamedTuple):
    """Runs of a patch as arrays.

    Attributes:
        order: Boot and sequence, shape ``(2, runs)``.
        t: Middle of each first row's time.
        dt: Period.
        first_row: Number of the first row.
        rows: How many.
        error: Time error.
        coverage: Coverage.
        steps: From sample to sample in rows, 0 without samples, shape ``(runs, columns)``.
        skew: Of each run and column.
        lo: Lower bounds, shape ``(columns, all rows)``.
        hi: Upper bounds.
    """

    order: Integers
    t: Integers
    dt: Integers
    first_row: Integers
    rows: Integers
    error: Integers
    coverage: Floats
    steps: Integers
    skew: Integers
    lo: Floats
    hi: Floats


def _tabulate(
    runs: Sequence[PatchRun], patches: Mapping[bytes, Patch], taxels: Sequence[str]
) -> _Table:
    rows = np.array([run.lo.shape[0] for run in runs])
    shape = len(taxels), int(rows.sum())
    lo, hi = np.full(shape, -np.inf), np.full(shape, np.inf)
    steps = np.zeros((len(runs), len(taxels)), np.int64)
    skew = np.zeros_like(steps)
    for name, patch in patches.items():
        mine = np.array([run.patch == name for run in runs])
        columns = np.array([taxels.index(taxel) for taxel in patch.taxels])
        cells = np.ix_(columns, np.flatnonzero(np.repeat(mine, rows)))
        lo[cells] = np.concatenate([run.lo for run in runs if run.patch == name]).T
        hi[cells] = np.concatenate([run.hi for run in runs if run.patch == name]).T
        even = bytes(columns.size)
        strides = np.array([list(run.strides or even) for run in runs if run.patch == name])
        steps[np.ix_(mine, columns)] = 1 << strides
        skew[np.ix_(mine, columns)] = patch.skew or (0,) * columns.size
    numbers = np.array([
        (run.boot, run.sequence, run.t, run.dt, run.first_row % 2**MOST_STRIDE, run.error)
        for run in runs
    ]).T  # fmt: skip
    coverage = np.array([run.coverage for run in runs])
    t, dt, first_row, error = numbers[2:]
    return _Table(numbers[:2], t, dt, first_row, rows, error, coverage, steps, skew, lo, hi)


def _locate(table: _Table, column: int, buckets: Buckets) -> _Samples:
    """Find a column's samples, in order of the runs' times, boots and sequences."""
    window, steps = buckets.window, np.maximum(table.steps[:, column], 1)
    first = -table.first_row % steps
    t, dt = table.t + first * table.dt + table.skew[:, column], table.dt * steps
    n = -((first - table.rows) // steps)
    begin = np.maximum(0, -((t - window.start) // dt))
    end = np.minimum(n, (window.end - 1 - t) // dt + 1)
    place, n = np.cumsum(table.rows) - table.rows + first + begin * steps, end - begin
    order = np.lexsort((table.order[1], table.order[0], t))
    here = order[((begin < end) & (table.steps[:, column] > 0))[order]]
    cells = None
    apart = place[here][1:] != (place + n)[here][:-1]  # also where only the window ends a run
    if np.any(steps[here] > 1) or np.any(apart):
        cells = _series(place[here], steps[here], n[here])  # they do not follow each other
        place[here] = np.cumsum(n[here]) - n[here]
    runs = np.stack([t + begin * dt, dt, n, place, table.error], axis=1)[here]
    return _Samples(np.ascontiguousarray(runs), t[here], table.coverage[here], cells)


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
    instants, rows = _series(t, dt, n), _series(place, np.ones_like(n), n)
    none = np.zeros(instants.size, np.int64)
    lo, hi = bounds[0][rows], bounds[1][rows]
    dts, errors = np.repeat(dt, n), np.repeat(error, n)
    each = Aggregates(
        *(instants, instants, none + 1, none, dts, errors),
        *(lo, hi, lo, hi, np.repeat(coverage, n)),
    )
    each = each[np.lexsort((np.repeat(begun, n), instants))]
    return each.grouped(buckets.of(each.first))


def _series(first: Integers, step: Integers, n: Integers) -> NDArray[np.int64]:
    """Numbers from a first one on in even steps, of all runs one after the other."""
    within = np.arange(n.sum()) - np.repeat(np.cumsum(n) - n, n)
    return np.asarray(np.repeat(first, n) + np.repeat(step, n) * within)
