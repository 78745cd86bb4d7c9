"""Reading a skin of 8,400 taxels: one channel, and pictures: `python -m benchmarks.skin_reads`.

Fills a store with frames of 100 ms at 50 Hz, as ingest writes them, and reads them fresh, then
compacted and with tiles.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from eskin_cloud.api.picture_formats import as_arrow
from eskin_cloud.query.pictures import read_pictures
from eskin_cloud.query.series import read_series
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store import Store
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window

from benchmarks.report import Row, at_most
from eskin.errors import QueryError
from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.messages import Position
from eskin.wire.timestamp import SECOND, format_timestamp
from tests.support.identities import Identities
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import NODE, START
from tests.unit.cloud.service import Service
from tests.unit.cloud.skins import describe

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_PATCHES: Final = 132
_COLUMNS: Final = 64
_PAGE: Final = 33
_PERIOD: Final = 20_000_000
_ROWS: Final = 5
_STRETCH: Final = _ROWS * _PERIOD
_VARIANTS: Final = 8
_AT_ONCE: Final = 40
_QUESTIONS: Final = 60
_ASKED: Final = 105
_STORED_MS: Final = 10.0
_ASKED_MS: Final = 25.0
_PICTURES_MS: Final = 300.0
_HOUR_S: Final = 3600
_DUE: Final = Due(2**62, 2**62)
"""Frames of any age are compacted."""


def skin() -> tuple[Layout, list[Patch]]:
    """Patches of 64 taxels, on pages that fit 64 KiB."""
    patches = [
        Patch(
            f"p{number}",
            "pressure",
            "Pa",
            tuple(f"p{number}-{column}" for column in range(_COLUMNS)),
            64.0,
            threshold=3000.0,
            cell_area=1e-6,
        )
        for number in range(_PATCHES)
    ]
    pages = (_PAGE,) * (_PATCHES // _PAGE)
    return Layout(tuple(patch.content_hash for patch in patches), pages), patches


def packed(patches: list[Patch], first_row: int, seed: int) -> list[PatchSamples]:
    """Samples of one stretch: noise of a quarter of their width."""
    random = np.random.default_rng(seed)
    found = []
    for number, patch in enumerate(patches):
        lo = 1000.0 + random.normal(0.0, 16.0, (_ROWS, _COLUMNS))
        values = Interval(lo, lo + 64.0 + random.uniform(0.0, 8.0, lo.shape))
        found.append(
            PatchSamples.pack(values, patch.least_width, patch=number, grid=0, first_row=first_row)
        )
    return found


def frames(seconds: int) -> Iterator[list[Frame]]:
    """Frames of all pages, some at once."""
    layout, patches = skin()
    variants = [packed(patches, 0, seed) for seed in range(_VARIANTS)]
    waiting, sequence = [], 0
    for stretch in range(seconds * SECOND // _STRETCH):
        first = START + stretch * _STRETCH
        grid = Grid(0, _PERIOD, stretch * _ROWS, _ROWS, 1.0)
        samples = variants[stretch % _VARIANTS]
        for page in range(len(layout.pages)):
            mine = tuple(samples[page * _PAGE : (page + 1) * _PAGE])
            waiting.append(
                Frame(
                    Position(1, sequence), layout.content_hash, page, stretch * _STRETCH,
                    (first, first + 4000), (grid,), mine,
                )
            )  # fmt: skip
            sequence += 1
        if len(waiting) >= _AT_ONCE:
            yield waiting
            waiting = []
    yield waiting


def ask(what: str, question: Callable[[], object]) -> None:
    """Print how long a question takes, and how long a processor works for it."""
    took, worked = [], []
    for _ in range(_QUESTIONS):
        begun, since = time.perf_counter(), time.thread_time()
        try:
            question()
        except QueryError as error:
            print(f"{what}: {error}", flush=True)
            return
        worked.append((time.thread_time() - since) * 1e3)
        took.append((time.perf_counter() - begun) * 1e3)
    half, most = np.percentile(took[5:], [50, 99])
    print(
        f"{what}: p50 {half:.1f} ms, p99 {most:.1f} ms, "
        f"of the processor {np.median(worked[5:]):.1f} ms",
        flush=True,
    )


def read(store: Store, seconds: int) -> None:
    """Read one channel, and pictures."""
    random = np.random.default_rng(3)
    end = START + seconds * SECOND

    def series() -> object:
        with store.read() as connection:
            number = int(random.integers(_PATCHES))
            row = find_channel(connection, NODE, f"p{number}-7.pressure")
            window = Window(end - 10 * SECOND, end)
            return read_series(connection, row, window, points=1000)

    def pictures(span: int) -> object:
        start = START + int(random.integers(max(1, seconds * SECOND - span)))
        with store.read() as connection:
            found = read_pictures(connection, NODE, Window(start, start + span), points=100)
        return as_arrow(found)

    ask("one channel, the last 10 s, 500 samples", series)
    for span in (2, 10, 60, 100, 600, 3600):
        if span <= seconds:
            ask(f"100 pictures of {span} s as Arrow", lambda: pictures(span * SECOND))  # noqa: B023


def measure_skin_reads(folder: Path, *, seconds: int) -> list[Row]:
    """Hulls of one channel, in the store and over HTTP, and pictures over HTTP; all compacted."""
    folder.mkdir()
    identities = Identities(folder / "pki")
    service = Service(folder / "cloud", identities, place=folder / "store.sqlite")
    with Store(service.place, clock=lambda: START + seconds * SECOND) as store:
        fill(store, seconds)
        compact(store)
        build(store)
    samples = seconds * SECOND // _PERIOD
    name = f"1,000 hulls of one of {_PATCHES * _COLUMNS} channels, {samples:.2g} samples"
    start, end = START, START + seconds * SECOND
    channel = "p3-7.pressure"
    with Store(service.place, clock=lambda: end) as store:

        def stored() -> None:
            with store.read() as connection:
                row = find_channel(connection, NODE, channel)
                read_series(connection, row, Window(start, end), points=1000)

        rows = [at_most(f"{name}, in the store, p99", _p99(stored), "ms", _STORED_MS)]
    with service, service.people(service.token()) as client:
        window = {"start": format_timestamp(start), "end": format_timestamp(end)}

        def asked() -> None:
            params = window | {"points": "1000"}
            client.get(f"/api/v1/series/{NODE}/{channel}", params=params).raise_for_status()

        random, span = np.random.default_rng(4), min(seconds, _HOUR_S) * SECOND

        def pictures() -> None:
            arrow = {"Accept": "application/vnd.apache.arrow.stream"}
            # Its last picture ends before the newest samples, as that of nearly any hour of a day.
            latest = max(seconds * SECOND - span - span // 50, 0)
            first = start + int(random.integers(latest + 1))
            times = {"start": format_timestamp(first), "end": format_timestamp(first + span)}
            params = times | {"points": "100"}
            place = f"/api/v1/nodes/{NODE}/frames"
            client.get(place, params=params, headers=arrow).raise_for_status()

        rows.append(at_most(f"{name}, over HTTP, p99", _p99(asked), "ms", _ASKED_MS))
        name = (
            f"100 pictures of {_PATCHES * _COLUMNS} taxels, from any {span // SECOND} s of "
            f"{seconds}, as Arrow over HTTP, p99"
        )
        rows.append(at_most(name, _p99(pictures), "ms", _PICTURES_MS))
    return rows


def _p99(question: Callable[[], None]) -> float:
    """Milliseconds; the first answers compile."""
    took = []
    for _ in range(_ASKED):
        begun = time.perf_counter()
        question()
        took.append((time.perf_counter() - begun) * 1e3)
    return float(np.percentile(took[5:], 99))


def fill(store: Store, seconds: int) -> int:
    """Fill a store with frames; gives their bytes."""
    layout, patches = skin()
    describe(store, layout, *patches)
    size = 0
    for some in frames(seconds):
        put(store, *some)
        size += sum(len(each.encode()) for each in some)
    return size


def compact(store: Store) -> None:
    """Compact all frames of a store."""
    for page in find_compactable_frames(store, _DUE):
        while compact_frames(store, page, _DUE):
            pass


def main() -> None:
    """Fill a store, and read it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="of frames")
    seconds = parser.parse_args().seconds
    with (
        tempfile.TemporaryDirectory() as folder,
        Store(Path(folder) / "store.sqlite", clock=lambda: START + seconds * SECOND) as store,
    ):
        begun = time.perf_counter()
        size = fill(store, seconds)
        print(
            f"{seconds} s of frames, {size / 1e6:.0f} MB, stored in "
            f"{time.perf_counter() - begun:.0f} s"
        )
        read(store, seconds)
        begun = time.perf_counter()
        compact(store)
        print(f"compacted in {time.perf_counter() - begun:.0f} s")
        begun = time.perf_counter()
        build(store)
        print(f"tiles built in {time.perf_counter() - begun:.0f} s")
        read(store, seconds)


if __name__ == "__main__":
    main()
