"""Formulas over a store of very many samples, of which hulls leave few stretches open.

``python -m benchmarks.stored_verdicts --samples 1e9`` builds a channel as `benchmarks.pyramid`
does, and touches it ten times: so at most ten hulls of a window are open. It asks
when a formula holds in windows of every length at any place, from the read transaction's beginning
to the last stretch.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from eskin_cloud.query.channel_runs import ChannelSource
from eskin_cloud.query.stored_verdicts import StoredVerdicts
from eskin_cloud.store import Store
from eskin_cloud.store.read.lookup import find_channel
from rich.progress import Progress

from benchmarks.long_store import DT, LongStore
from benchmarks.questions import Took, windows
from benchmarks.report import Row
from eskin.monitor import parse
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_cloud.store.location import StoreLocation

FORMULAS: Final = {
    "one comparison": f"{CHANNEL} > 1.9",
    "a window of the past": f"once[0,50ms] {CHANNEL} > 1.9",
    "two comparisons and a window": f"rise({CHANNEL} > 1.9) and once[0,50ms] {CHANNEL} < -0.5",
}
_TOUCHES: Final = 10
_TOUCH: Final = 5
_SURE: Final = 3
"""Of the samples of a touch, those whose whole interval is above."""
_MOST_MS: Final = 50.0


def measure_stored_verdicts(place: StoreLocation, *, samples: int, questions: int) -> list[Row]:
    """Fill a store and ask it; gives milliseconds."""
    with Store(place) as store:
        _fill(store, samples)
        return list(_measured(store, samples, questions))


def _fill(store: Store, samples: int) -> None:
    with Progress() as screen:
        long = LongStore(store, screen)
        long.grow(samples)
        long.repeat_tiles()
    random = np.random.default_rng(3)
    lo = np.full(_TOUCH, 1.8)
    lo[:_SURE] = 2.0
    for number, instant in enumerate(random.integers(0, samples * DT, _TOUCHES).tolist()):
        time_ = START + instant, START + instant
        put(store, stretch(number, lo, lo + 0.2, boot=2, time=time_, dt=DT))
    compact_all(store)
    LongStore(store, Progress()).build()


def _measured(store: Store, samples: int, questions: int) -> Iterator[Row]:
    for name, text in FORMULAS.items():
        formula, took, found = parse(text), [], 0
        for window in windows(samples * DT, questions):
            begun = time.perf_counter()
            with store.read() as connection:
                source = ChannelSource(connection, find_channel(connection, NODE, CHANNEL))
                found += sum(1 for _ in StoredVerdicts(formula, {CHANNEL: source}).pieces(window))
            took.append(time.perf_counter() - begun)
        half, most = Took.of(took)
        title = f"{name} over any window of {samples:.0e} samples"
        yield Row(f"{title}, stretches found in each", found / len(took), "")
        yield Row(f"{title}, p50", half, "ms")
        ratio = _MOST_MS / most
        yield Row(f"{title}, p99", most, "ms", None, None, ratio, 1.0, ratio >= 1.0)


def main() -> None:
    """Measure on an SQLite file, and say so line by line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.stored_verdicts", description=__doc__
    )
    parser.add_argument("--samples", type=float, default=1e7)
    parser.add_argument("--questions", type=int, default=200)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="eskin-verdicts-") as folder:
        place = Path(folder) / "store.sqlite"
        rows = measure_stored_verdicts(
            place, samples=int(options.samples), questions=options.questions
        )
    for row in rows:
        print(f"{row.name}: {row.value:.2f} {row.unit}")


if __name__ == "__main__":
    main()
