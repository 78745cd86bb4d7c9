"""Bytes and speed of compacted frames and their tiles: `python -m benchmarks.patch_rows`.

Runs the packaged hand's firmware on its scenario as fast as it goes, frames its samples, joins the
frames of each patch, and builds tiles of them.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from eskin_cloud.rollup.blocks import Buckets
from eskin_cloud.rollup.column_aggregates import joined, pack
from eskin_cloud.rollup.patch_folding import fold_runs
from eskin_cloud.store.patch_rows import decode_runs, encode_runs
from eskin_cloud.store.patch_run import PatchRun
from eskin_cloud.store.sample_grid import PATCH_CHUNK, STEP, patch_level

from benchmarks.frames import Measured, measure, sizes
from benchmarks.report import Row, at_most
from eskin.interval import Interval
from eskin.wire.frames import Patch, Sampling, decode_samples, encode_samples

if TYPE_CHECKING:
    from collections.abc import Callable

_SECONDS: Final = 100
_BILLION: Final = 1_000_000_000
_STRETCH: Final = 100_000_000
_COLUMNS: Final = 64
_PERIODS: Final = (20_000_000, 4_000_000)
_LENGTHS: Final = (10, 60)
_REPEATS: Final = 7
_WIRE_ROWS: Final = 3
_MOST_OF_WIRE: Final = 1.5
_MOST_OF_COMPACTED: Final = 0.8
_MOST_OF_PYRAMID: Final = 0.25
_START: Final = 1_790_000_000_000_000_000


def runs_of(patch: Measured, seconds: int, period: int | None = None) -> list[PatchRun]:
    """Frames of 100 ms of a patch, with the codec's rounding and a clock that wanders."""
    dt = period or patch.period
    rows, random = max(1, _STRETCH // dt), np.random.default_rng(1)
    sampling, runs = Sampling(rows, patch.values.shape[1]), []
    for first in range(0, seconds * _BILLION // dt - rows + 1, rows):
        values = patch.values[first : first + rows]
        read = decode_samples(encode_samples(values, sampling, patch.least_width), sampling)
        ticks = first * dt
        t, error = _START + ticks + int(random.normal(0, 300)), 2000 + int(random.integers(0, 400))
        place = 1, 100_000 + 2 * first // rows, ticks, t, error, dt, first
        runs.append(PatchRun(bytes(32), *place, b"", 0, (), 1.0, read.inf, read.sup))
    return runs


def tile_bytes(patch: Measured) -> tuple[int, int, int]:
    """Bytes of whole chunks of the lowest level and of the next one, and their samples."""
    runs, columns = runs_of(patch, _SECONDS), patch.values.shape[1]
    taxels = tuple(f"t{column}" for column in range(columns))
    described = {bytes(32): Patch("patch", "pressure", patch.unit, taxels, patch.least_width)}
    grain = patch_level(patch.period)
    bits = grain + PATCH_CHUNK
    first, last = (runs[0].t >> bits) + 1, runs[-1].t >> bits
    chunks = [
        fold_runs(runs, described, Buckets(n << bits, 1 << grain, 1 << PATCH_CHUNK))
        for n in range(first, first + (last - first) // 4 * 4)
    ]
    if not chunks:
        return 0, 0, 0
    above = [
        joined([each.grouped(grain + STEP) for each in chunks[k : k + 4]])
        for k in range(0, len(chunks), 4)
    ]
    lowest, next_ = (sum(len(pack(each)) for each in level) for level in (chunks, above))
    return lowest, next_, sum(int(each.pieces.n.sum()) for each in chunks)


def milliseconds(work: Callable[[], object]) -> float:
    """The least time of some."""
    found = []
    for _ in range(_REPEATS):
        begin = time.perf_counter()
        work()
        found.append(time.perf_counter() - begin)
    return min(found) * 1e3


def measure_bytes(folder: Path) -> list[Row]:
    """Bytes a sample of the packaged hand on its scenario: on the wire, compacted, in tiles."""
    folder.mkdir()
    patches = measure(folder, _SECONDS)
    wire = sizes(patches, _WIRE_ROWS)["frame"]
    name = "hand, bytes a sample"
    rows = [at_most(f"{name}, frames of {_WIRE_ROWS} rows", wire, "B", _MOST_OF_WIRE)]
    for seconds in _LENGTHS:
        size = _compacted(patches, seconds)
        rows.append(at_most(f"{name}, compacted to {seconds} s", size, "B", _MOST_OF_COMPACTED))
    return [*rows, at_most(f"{name}, pyramid", _pyramid(patches), "B", _MOST_OF_PYRAMID)]


def _compacted(patches: list[Measured], seconds: int) -> float:
    size = samples = 0
    for patch in patches:
        runs = runs_of(patch, seconds)
        size += len(encode_runs(runs))
        samples += sum(run.lo.size for run in runs)
    return size / samples


def _pyramid(patches: list[Measured]) -> float:
    lowest, next_, samples = map(sum, zip(*map(tile_bytes, patches), strict=True))
    # Each level above that one has a quarter of it.
    return float((lowest + next_ * 4 / 3) / samples)


def main() -> None:
    """Print bytes a sample, then times."""
    with tempfile.TemporaryDirectory() as folder:
        patches = measure(Path(folder), _SECONDS)
    for seconds in _LENGTHS:
        size = _compacted(patches, seconds)
        print(f"hand, rows of {seconds} s: {size:.3f} bytes a sample")
    print(f"hand, tiles: {_pyramid(patches):.3f} bytes a sample")
    pressure = next(each for each in patches if each.unit == "Pa")
    wide = Interval.concatenate([pressure.values] * 5, axis=1)[:, :_COLUMNS]
    for period in _PERIODS:
        for seconds in _LENGTHS:
            repeated = Interval.concatenate([wide] * 2, axis=0)
            runs = runs_of(pressure._replace(values=repeated), seconds, period)
            data = encode_runs(runs)
            print(
                f"{_COLUMNS} columns, {_BILLION // period} Hz, {seconds} s:",
                f"{len(data) / sum(run.lo.size for run in runs):.3f} bytes a sample,",
                f"{milliseconds(lambda: encode_runs(runs)):.2f} ms to write,",  # noqa: B023
                f"{milliseconds(lambda: decode_runs(data)):.2f} to read all,",  # noqa: B023
                f"{milliseconds(lambda: decode_runs(data, [7])):.2f} to read one column",  # noqa: B023
            )


if __name__ == "__main__":
    main()
