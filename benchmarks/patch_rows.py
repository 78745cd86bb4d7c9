"""Bytes and speed of compacted frames and their tiles: `python -m benchmarks.patch_rows`.

Runs the packaged hand's firmware on its scenario as fast as it goes, joins the frames of each
patch, and builds tiles of them.
"""

from __future__ import annotations

import tempfile
import time
from collections import defaultdict
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from eskin_cloud.rollup.buckets import Buckets
from eskin_cloud.rollup.column_aggregates import joined, pack
from eskin_cloud.rollup.patch_folding import fold_runs
from eskin_cloud.store.patch_rows import decode_column, decode_runs, encode_runs
from eskin_cloud.store.read.patch_runs import runs_of_frames
from eskin_cloud.store.sample_grid import PATCH_CHUNK, STEP, patch_level

from benchmarks.frames import shorten, sizes, write_frames
from benchmarks.report import Row, at_most
from eskin.wire.frames import DescribedLayout, Patch

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_cloud.store.patch_run import PatchRun

    from eskin.interval import Floats

_SECONDS: Final = 100
_BILLION: Final = 1_000_000_000
_STRETCH_MS: Final = 100.0
_COLUMNS: Final = 64
_LENGTHS: Final = (10, 60)
_REPEATS: Final = 7
_WIRE_ROWS: Final = 3
_MOST_OF_WIRE: Final = 1.5
_MOST_OF_COMPACTED: Final = 0.8
_MOST_OF_PYRAMID: Final = 0.25


class Measured(NamedTuple):
    """What the frames of a node hold of one patch."""

    patch: Patch
    runs: list[PatchRun]


def measure(folder: Path, seconds: int) -> list[Measured]:
    """Frames of the packaged hand on its scenario, patch by patch, with a clock that wanders."""
    _, layout, written = write_frames(folder, "hand", stretch=_STRETCH_MS, seconds=seconds)
    described = DescribedLayout.of(layout.layout, layout.patches)
    random = np.random.default_rng(1)
    runs: dict[int, list[PatchRun]] = defaultdict(list)
    for sequence, kept in enumerate(written):
        t, error = int(random.normal(0, 300)), 2000 + int(random.integers(0, 400))
        row = {"boot": 1, "sequence": 100_000 + 2 * sequence, "data": kept.body}
        for number, run in runs_of_frames([row], described, range(len(layout.patches))):
            runs[number].append(run._replace(t=run.t + t, error=error))
    return [Measured(layout.patches[number], found) for number, found in sorted(runs.items())]


def tile_bytes(measured: Measured) -> tuple[int, int, int]:
    """Bytes of whole chunks of the lowest level and of the next one, and their samples."""
    runs = measured.runs
    described = {runs[0].patch: measured.patch}
    grain = patch_level(runs[0].dt)
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
    for name in "wire", "compacted":
        (folder / name).mkdir(parents=True)
    *_, wire, _ = sizes(folder / "wire", "hand", shorten("hand", _WIRE_ROWS))
    patches = measure(folder / "compacted", _SECONDS)
    name = "hand, bytes a sample"
    rows = [at_most(f"{name}, frames of {_WIRE_ROWS} rows", wire, "B", _MOST_OF_WIRE)]
    for seconds in _LENGTHS:
        size = _compacted(patches, seconds)
        rows.append(at_most(f"{name}, compacted to {seconds} s", size, "B", _MOST_OF_COMPACTED))
    return [*rows, at_most(f"{name}, pyramid", _pyramid(patches), "B", _MOST_OF_PYRAMID)]


def _compacted(patches: list[Measured], seconds: int) -> float:
    size = samples = 0
    for _, runs in patches:
        for _, group in groupby(runs, lambda run: run.ticks // (seconds * _BILLION)):
            row = list(group)
            size += len(encode_runs(row))
            samples += sum(run.lo.size for run in row)
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
    pressure = next(each.runs for each in patches if each.patch.unit == "Pa")
    for seconds in _LENGTHS:
        runs = [
            run._replace(lo=_widen(run.lo), hi=_widen(run.hi))
            for run in pressure
            if run.ticks < seconds * _BILLION
        ]
        data = encode_runs(runs)
        print(
            f"{_COLUMNS} columns, {_BILLION / runs[0].dt:.0f} Hz, {seconds} s:",
            f"{milliseconds(lambda: encode_runs(runs)):.2f} ms to write,",  # noqa: B023
            f"{milliseconds(lambda: decode_runs(data)):.2f} to read all,",  # noqa: B023
            f"{milliseconds(lambda: decode_column(data, 7)):.2f} to read one column",  # noqa: B023
        )


def _widen(values: Floats) -> Floats:
    return np.tile(values, (1, -(-_COLUMNS // values.shape[1])))[:, :_COLUMNS]


if __name__ == "__main__":
    main()
