"""Samples of frames that one process reads and commits: `python -m benchmarks.frame_ingest`.

Into SQLite in a temporary folder, each batch with a synced commit. The processor's time is printed,
too, as other processes do not change it much.
"""

from __future__ import annotations

import tempfile
import time
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final, NamedTuple

import cbor2
import numpy as np
from eskin_cloud.ingest.batch import read_batch
from eskin_cloud.store import Store
from eskin_cloud.store.descriptions import read_description, store_descriptions
from eskin_cloud.store.write.ingest import STORED, ingest

from benchmarks.report import Row
from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.messages import Position

if TYPE_CHECKING:
    from collections.abc import Sequence

_NODE: Final = "hand"
_START: Final = 1_790_000_000_000_000_000
_BATCHES: Final = 10
_ROUNDS: Final = 3
_LEAST: Final = 20.0
"""Million samples a second, synced."""
_TIMES: Final = 3.0
"""How many times as fast as DuckDB."""


class Case(NamedTuple):
    """Frames that are measured.

    Attributes:
        name: What they are.
        columns: Of each patch.
        rows: Of each frame.
        period: From row to row, ns.
        frames: How many.
    """

    name: str
    columns: tuple[int, ...]
    rows: int
    period: int
    frames: int


_CASES: Final = (
    Case("13 patches, 83 channels, 12 rows", (7,) * 5 + (6,) * 8, 12, 4_000_000, 2000),
    Case("30 patches of 64 channels, 5 rows", (64,) * 30, 5, 20_000_000, 400),
)


def make(case: Case) -> tuple[list[bytes], list[bytes]]:
    """Descriptions, and frames whose samples walk at random."""
    patches = [
        Patch(f"p{k}", "pressure", "Pa", tuple(f"p{k}-{c}" for c in range(size)), 64.0)
        for k, size in enumerate(case.columns)
    ]
    layout = Layout(tuple(each.content_hash for each in patches), (len(patches),))
    random, grid = np.random.default_rng(1), Grid(0, case.period, 0, case.rows, 1.0)
    total = sum(case.columns)
    steps = random.normal(0.0, 8.0, (case.frames * case.rows, total))
    lo = random.normal(1000.0, 100.0, total) + np.cumsum(steps, axis=0)
    hi = lo + 64.0 + 8.0 * random.random(lo.shape)
    ends = np.cumsum((0, *case.columns))
    frames = []
    for number in range(case.frames):
        rows = slice(number * case.rows, (number + 1) * case.rows)
        packed = tuple(
            PatchSamples.pack(
                Interval(lo[rows, begin:end], hi[rows, begin:end]),
                64.0,
                patch=patch,
                grid=0,
                first_row=0,
            )
            for patch, (begin, end) in enumerate(pairwise(ends))
        )
        at = _START + number * case.rows * case.period
        name = layout.content_hash
        frames.append(Frame(Position(1, number), name, 0, number, (at, at + 4000), (grid,), packed))
    described = [layout.encode(), *(each.encode() for each in patches)]
    return described, [each.encode() for each in frames]


def run(described: Sequence[bytes], bodies: Sequence[bytes]) -> tuple[float, float]:
    """Seconds, and seconds of the processor, to read and commit all bodies."""
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder) / "store.sqlite") as store:
        known = [read_description(data) for data in described]
        store.write_and_wait(lambda connection: store_descriptions(connection, _NODE, known))
        begun, used = time.perf_counter(), time.process_time()
        for body in bodies:
            items = read_batch(body)
            outcome = store.write_and_wait(
                lambda connection, items=items: ingest(  # type: ignore[misc]  # inferred
                    connection, store.cache, items, gateway="g", now=_START, dead_letters=1
                )
            )
            assert {receipt.result for receipt in outcome.results} == {STORED}
        return time.perf_counter() - begun, time.process_time() - used


def measure_frame_ingest(folder: Path) -> list[Row]:
    """Samples a second of each case, with DuckDB in turns; each has the median of its rounds."""
    from benchmarks.row_stores import DuckDBRows  # noqa: PLC0415 - only `make bench` has its library

    folder.mkdir()
    with ExitStack() as stack:
        peer = DuckDBRows(folder, stack)
        cases = {case: _bodies(case) for case in _CASES}
        rates: dict[Case | str, list[float]] = {each: [] for each in (*_CASES, peer.name)}
        busy: dict[Case, list[float]] = {case: [] for case in _CASES}
        for number in range(_ROUNDS + 1):
            for case, (described, bodies) in cases.items():
                wall, used = run(described, bodies)
                rates[case].append(_samples(case) / wall / 1e6)
                busy[case].append(_samples(case) / used / 1e6)
            peer.prepare(number * peer.samples)
            begun = time.perf_counter()
            peer.store()
            rates[peer.name].append(peer.samples / (time.perf_counter() - begun) / 1e6)
        # The first round of all compiles.
        found = {name: median(each[1:]) for name, each in rates.items()}
    rows, unit, other = [], "Msamples/s", found[peer.name]
    for case in _CASES:
        name, rate = f"frames into SQLite, {case.name}", found[case]
        ratio = rate / other
        rows += [
            Row(name, rate, unit, target=_LEAST, met=rate >= _LEAST),
            Row(name, rate, unit, peer.name, other, ratio, _TIMES, ratio >= _TIMES),
            Row(f"{name}, a second of CPU", median(busy[case][1:]), unit),
        ]
    return rows


def _samples(case: Case) -> int:
    return sum(case.columns) * case.rows * case.frames


def _bodies(case: Case) -> tuple[list[bytes], list[bytes]]:
    """Descriptions, and bodies of requests."""
    described, frames = make(case)
    size = len(frames) // _BATCHES
    bodies = [
        cbor2.dumps([[_NODE, data] for data in frames[begin : begin + size]])
        for begin in range(0, len(frames), size)
    ]
    read_batch(bodies[0])
    return described, bodies


def main() -> None:
    """Print the best of some rounds of each case."""
    for case in _CASES:
        described, bodies = _bodies(case)
        rounds = [run(described, bodies) for _ in range(_ROUNDS)]
        samples = _samples(case) / 1e6
        wall, used = (min(each[k] for each in rounds) for k in range(2))
        size = sum(map(len, bodies)) / case.frames
        print(
            f"{case.name}: {samples / wall:.1f} M samples/s; {samples / used:.1f} a second of the "
            f"processor; {size:.0f} bytes a frame"
        )


if __name__ == "__main__":
    main()
