"""Questions to a store of very many samples: 1000 hulls of any window, as quick as of a few.

``python -m benchmarks.pyramid --samples 1e9`` builds a channel of 1 kHz in blocks of 500 and asks
for windows of every length at any place. Blocks repeat after a while; each is stored and indexed as
if it were new. The disk must hold 10 bytes a sample.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from itertools import count, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from benchmarks.report import Row
from cloud.pyramid.building import build
from cloud.query.places import find_channel
from cloud.query.series import read_series
from cloud.query.window import Window
from cloud.store import Store
from cloud.store.bulk import insert_many
from cloud.store.channels import add_block
from cloud.store.schema import blocks, channels
from eskin.messages import BlockSummary, Encoding, decode_summary
from tests.cloud.clouds import put
from tests.cloud.messages import CHANNEL, NODE, START, block

if TYPE_CHECKING:
    from collections.abc import Iterator

    from cloud.store.place import Place

_SAMPLES: Final = 500
_DT: Final = 1_000_000
_PATTERNS: Final = 64
_BATCH: Final = 5000
_POINTS: Final = 1000
_MOST_MS: Final = 10.0
_GROWTH: Final = 1.5


def measure_pyramid(
    place: Place, *, samples: int, questions: int, processor: bool = False
) -> list[Row]:
    """Fill a store, build its pyramid, ask; gives milliseconds.

    Args:
        place: Of an empty store.
        samples: How many in the end; a hundredth of it is asked first.
        questions: How many at each size.
        processor: Count the thread's time on the processor alone, where others use it, too.
    """
    said = list(islice(patterns(), _PATTERNS))
    found: dict[int, tuple[float, float]] = {}
    with Store(place) as store:
        standing = 0
        put(store, block(0, boot=2, dt=_DT))
        for size in (samples // 100, samples):
            begun = time.perf_counter()
            fill(store, said, standing, size // _SAMPLES)
            filled = time.perf_counter()
            build(store)
            built = time.perf_counter()
            print(f"{size:.0e}: filled {filled - begun:.0f} s, built {built - filled:.0f} s")
            standing = size // _SAMPLES
            found[size] = _ask(store, size * _DT, questions, processor=processor)
    return list(_rows(found))


def _rows(found: dict[int, tuple[float, float]]) -> Iterator[Row]:
    few, many = sorted(found)
    for size, (half, most) in found.items():
        name = f"{_POINTS} hulls of any window of {size:.0e} samples"
        yield Row(f"{name}, p50", half, "ms")
        ratio = _MOST_MS / most
        yield Row(f"{name}, p99", most, "ms", None, None, ratio, 1.0, ratio >= 1.0)
    for at, word in enumerate(("p50", "p99")):
        ratio = found[few][at] / found[many][at]
        title = f"the same: {word} of {few:.0e} samples against {many:.0e}"
        yield Row(title, ratio, "", None, None, ratio, 1 / _GROWTH, ratio >= 1 / _GROWTH)


def patterns(dt: int = _DT) -> Iterator[tuple[BlockSummary, dict[str, Any]]]:
    """Blocks as the store reads and keeps them, of samples ``dt`` ns apart."""
    random = np.random.default_rng(1)
    for number in count():
        lo = np.sin(np.arange(_SAMPLES) / 50 + number) + random.normal(0, 0.01, _SAMPLES)
        made = block(number, lo, lo + 0.05, dt=dt, time=(START, START), encoding=Encoding.Q16)
        row = {"node": NODE, "boot": 1, "channel": CHANNEL, "error": 0, "dt": dt, "n": _SAMPLES}
        row |= {
            "lo": made.bounds[0],
            "hi": made.bounds[1],
            "coverage": 1.0,
            "received": START,
            "packed": None,
        }
        data = made.encode()
        summary = decode_summary(data)
        assert isinstance(summary, BlockSummary)
        yield summary, row | {"data": data}


def fill(
    store: Store, said: list[tuple[BlockSummary, dict[str, Any]]], standing: int, end: int
) -> None:
    """Write blocks as ingest does, without reading messages again."""
    dt = said[0][1]["dt"]
    span = _SAMPLES * dt
    for first in range(standing, end, _BATCH):
        numbers = range(first, min(first + _BATCH, end))
        rows = []
        for number in numbers:
            t = START + number * span
            place = {"sequence": number, "cursor": number, "t": t, "t_end": t + span - dt}
            rows.append(said[number % len(said)][1] | place | {"t_lo": t, "t_hi": t})

        def keep(connection: Any, rows: list[dict[str, Any]] = rows) -> None:
            insert_many(connection, blocks, rows)
            add_block(connection, store.ledger, NODE, said[0][0])
            row = store.ledger.row(connection, channels, NODE, CHANNEL)
            assert row is not None
            row["t_last"] = rows[-1]["t_end"]
            store.ledger.save(connection)

        store.write(keep).result()


def _ask(store: Store, span: int, questions: int, *, processor: bool) -> tuple[float, float]:
    """Windows from a minute to all, evenly in their logarithms; p50 and p99 in ms."""
    random = np.random.default_rng(7)
    clock = time.thread_time if processor else time.perf_counter
    took = []
    for number in range(questions + 20):
        length = int(60e9 * (span / 60e9) ** random.random())
        start = START + int((span - length) * random.random())
        begun = clock()
        with store.read() as connection:
            row = find_channel(connection, NODE, CHANNEL)
            read_series(connection, row, Window(start, start + length), points=_POINTS)
        if number >= 20:  # the first ones load and warm what is used
            took.append((clock() - begun) * 1e3)
    half, most = np.percentile(took, [50, 99])
    return float(half), float(most)


def main() -> None:
    """Measure on an SQLite file, and say so line by line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pyramid", description=__doc__)
    parser.add_argument("--samples", type=float, default=1e8)
    parser.add_argument("--questions", type=int, default=500)
    parser.add_argument("--processor", action="store_true", help="time on the processor alone")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="eskin-pyramid-") as folder:
        place = Path(folder) / "store.sqlite"
        rows = measure_pyramid(
            place,
            samples=int(options.samples),
            questions=options.questions,
            processor=options.processor,
        )
        size = sum(each.stat().st_size for each in Path(folder).iterdir())
        print(f"{size / options.samples:.2f} bytes a sample")
    for row in rows:
        print(f"{row.name}: {row.value:.2f} {row.unit}")


if __name__ == "__main__":
    main()
