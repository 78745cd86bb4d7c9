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
from eskin_cloud.store import Store
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window

from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.messages import Position
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import NODE, START
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
    """Print how long a question takes."""
    took = []
    for _ in range(_QUESTIONS):
        begun = time.perf_counter()
        question()
        took.append((time.perf_counter() - begun) * 1e3)
    half, most = np.percentile(took[5:], [50, 99])
    print(f"{what}: p50 {half:.1f} ms, p99 {most:.1f} ms", flush=True)


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
    for span in (2, 10, 60, 600, 3600):
        if span <= seconds:
            ask(f"100 pictures of {span} s as Arrow", lambda: pictures(span * SECOND))  # noqa: B023


def main() -> None:
    """Fill a store, and read it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="of frames")
    seconds = parser.parse_args().seconds
    layout, patches = skin()
    with (
        tempfile.TemporaryDirectory() as folder,
        Store(Path(folder) / "store.sqlite", clock=lambda: START + seconds * SECOND) as store,
    ):
        describe(store, layout, *patches)
        begun, size = time.perf_counter(), 0
        for some in frames(seconds):
            put(store, *some)
            size += sum(len(each.encode()) for each in some)
        print(
            f"{seconds} s of frames, {size / 1e6:.0f} MB, stored in "
            f"{time.perf_counter() - begun:.0f} s"
        )
        read(store, seconds)


if __name__ == "__main__":
    main()
