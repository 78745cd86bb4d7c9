"""Bytes and speed of compacted frames: `python -m benchmarks.patch_rows`.

Runs the packaged hand's firmware on its scenario as fast as it goes, frames its samples anew, and
joins the frames of each patch.
"""

from __future__ import annotations

import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from eskin_cloud.store.patch_rows import decode_runs, encode_runs
from eskin_cloud.store.patch_run import PatchRun
from eskin_sensor_node.firmware.message_writer import FRAME
from eskin_sensor_node.node.offline import offline_node
from eskin_sensor_node.settings import NodeSettings

from eskin.interval import Interval
from eskin.wire.frames import Frame, Sampling, decode_samples, encode_samples

if TYPE_CHECKING:
    from collections.abc import Callable

_SECONDS: Final = 61
_BILLION: Final = 1_000_000_000
_STRETCH: Final = 100_000_000
_COLUMNS: Final = 64
_PERIODS: Final = (20_000_000, 4_000_000)
_LENGTHS: Final = (10, 60)
_REPEATS: Final = 7
_START: Final = 1_790_000_000_000_000_000


class Measured(NamedTuple):
    """What one patch has measured.

    Attributes:
        period: ns.
        unit: UCUM code.
        values: Shape ``(samples, channels)``.
        least_width: As its description states it.
    """

    period: int
    unit: str
    values: Interval
    least_width: float


def measure(folder: Path, seconds: int) -> list[Measured]:
    """What the hand measures in so many seconds."""
    given: dict[str, Any] = {
        "node": {"name": "hand", "profile": "hand", "seed": 7},
        "identity": {"directory": folder, "site": folder},
        "flash": {"path": folder / "flash"},
        "truth": {"path": folder / "truth"},
    }
    values: dict[int, list[Interval]] = defaultdict(list)
    periods: dict[int, int] = {}
    with offline_node(NodeSettings(**given)) as offline:
        offline.run_until(seconds * _BILLION)
        for kept in offline.flash.after((-1, -1), 1_000_000):
            if kept.kind == FRAME:
                frame = Frame.decode(kept.body)
                for samples, found in zip(frame.patches, frame.values, strict=True):
                    values[samples.patch].append(found)
                    periods[samples.patch] = frame.grids[samples.grid].period
        patches = offline.layout.patches
    return [
        Measured(
            periods[number],
            patches[number].unit,
            Interval.concatenate(each, axis=0),
            patches[number].least_width,
        )
        for number, each in sorted(values.items())
    ]


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


def milliseconds(work: Callable[[], object]) -> float:
    """The least time of some."""
    found = []
    for _ in range(_REPEATS):
        begin = time.perf_counter()
        work()
        found.append(time.perf_counter() - begin)
    return min(found) * 1e3


def main() -> None:
    """Print bytes a sample, then times."""
    with tempfile.TemporaryDirectory() as folder:
        patches = measure(Path(folder), _SECONDS)
    for seconds in _LENGTHS:
        size = samples = 0
        for patch in patches:
            runs = runs_of(patch, seconds)
            size += len(encode_runs(runs))
            samples += sum(run.lo.size for run in runs)
        print(f"hand, rows of {seconds} s: {size / samples:.3f} bytes a sample")
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
