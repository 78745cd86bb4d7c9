"""Questions to a store of very many samples: 1000 hulls of any window, as quick as of a few.

``python -m benchmarks.pyramid --samples 1e9`` builds a channel of 1 kHz, compacted as in an old
store by what repeats (`benchmarks.long_store`), and a hundredth of it in another. It asks both in
turns for windows of every length at any place, in the store, and over HTTP with a token. The disk
must hold 3 bytes a sample.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from eskin_cloud.store import Store
from rich.progress import Progress

from benchmarks.long_store import DT, LongStore
from benchmarks.questions import IN_STORE, POINTS, ask_in_turns, ask_service, ask_store
from benchmarks.report import Row
from tests.support.identities import Identities
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from eskin_cloud.store.location import StoreLocation
    from eskin_cloud.store.read.window import Window

    from benchmarks.questions import Took

_MOST_MS: Final = {IN_STORE: 10.0}
_MOST_SERVED_MS: Final = 25.0
_GROWTH: Final = 1.5


def measure_pyramid(
    places: Mapping[int, StoreLocation], folder: Path, *, questions: int, processor: bool = False
) -> list[Row]:
    """Fill two stores, build their pyramids, ask both in turns; gives milliseconds.

    Args:
        places: Of stores, empty or filled here before, by the samples that they hold in the end.
        folder: For the cloud's files.
        questions: How many at each size.
        processor: Count time on the processor alone, where others use it, too: the asking thread's
            in the store, and all of the cloud's over HTTP.
    """
    identities = Identities(folder / "pki")
    asking: dict[int, Callable[[Window], Mapping[str, float]]] = {}
    with ExitStack() as stack:
        for size, place in places.items():
            store = stack.enter_context(Store(place))
            _grow(store, size)
            asking[size] = partial(ask_store, store, processor=processor)
        found = ask_in_turns(asking, DT, questions)
    with ExitStack() as stack:
        for size, place in places.items():
            cloud = Service(folder / f"{size:.0e}", identities, place=place)
            service = stack.enter_context(cloud)
            client = stack.enter_context(service.people(service.token()))
            asking[size] = partial(ask_service, service, client, processor=processor)
        served = ask_in_turns(asking, DT, questions)
    return list(_rows({size: found[size] | served[size] for size in places}))


def _grow(store: Store, size: int) -> None:
    with Progress() as screen:
        long = LongStore(store, screen)
        begun = time.perf_counter()
        long.grow(size)
        filled = time.perf_counter()
        long.repeat_tiles()
        built = time.perf_counter()
    print(f"{size:.0e}: filled {filled - begun:.0f} s, built {built - filled:.0f} s")


def _rows(found: Mapping[int, Mapping[str, Took]]) -> Iterator[Row]:
    few, many = sorted(found)
    for size, ways in found.items():
        for way, took in ways.items():
            name = f"{POINTS} hulls of any window of {size:.0e} samples, {way}"
            yield Row(f"{name}, p50", took.half, "ms")
            ratio = _MOST_MS.get(way, _MOST_SERVED_MS) / took.most
            yield Row(f"{name}, p99", took.most, "ms", None, None, ratio, 1.0, ratio >= 1.0)
    for way, took in found[few].items():
        for at, word in enumerate(("p50", "p99")):
            ratio = took[at] / found[many][way][at]
            title = f"the same {way}: {word} of {few:.0e} samples against {many:.0e}"
            yield Row(title, ratio, "", None, None, ratio, 1 / _GROWTH, ratio >= 1 / _GROWTH)


def main() -> None:
    """Measure on an SQLite file, and say so line by line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pyramid", description=__doc__)
    parser.add_argument("--samples", type=float, default=1e8)
    parser.add_argument("--questions", type=int, default=500)
    parser.add_argument("--processor", action="store_true", help="time on the processor alone")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="eskin-pyramid-") as folder:
        samples = int(options.samples)
        places = {size: Path(folder) / f"{size:.0e}.sqlite" for size in (samples // 100, samples)}
        rows = measure_pyramid(
            places, Path(folder), questions=options.questions, processor=options.processor
        )
        print(f"{places[samples].stat().st_size / samples:.2f} bytes a sample")
    for row in rows:
        print(f"{row.name}: {row.value:.2f} {row.unit}")


if __name__ == "__main__":
    main()
