"""Questions for hulls of windows of every length, in the store and over HTTP."""

from __future__ import annotations

import time
from collections import defaultdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np
from eskin_cloud.query.series import read_series
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window

from tests.unit.cloud.messages import CHANNEL, NODE, START

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    import httpx
    from eskin_cloud.store import Store

    from tests.unit.cloud.service import Service

POINTS: Final = 1000
IN_STORE: Final = "in the store"
FORMATS: Final = {
    "over HTTP in JSON": "application/json",
    "over HTTP in Arrow": "application/vnd.apache.arrow.stream",
}
_SHORTEST: Final = 60e9
_WARMING: Final = 20


class Took(NamedTuple):
    """Milliseconds of many questions: half of them, and 99 of 100, took no longer."""

    half: float
    most: float

    @classmethod
    def of(cls, seconds: list[float]) -> Self:
        """But for the first ones, which load and warm what is used."""
        half, most = np.percentile(np.array(seconds[_WARMING:]) * 1e3, [50, 99])
        return cls(float(half), float(most))


def windows(span: int, questions: int) -> Iterator[Window]:
    """Windows from a minute to all, evenly in their logarithms, at any place."""
    random = np.random.default_rng(7)
    for _ in range(questions + _WARMING):
        length = int(_SHORTEST * (span / _SHORTEST) ** random.random())
        start = START + int((span - length) * random.random())
        yield Window(start, start + length)


def ask_in_turns(
    asking: Mapping[int, Callable[[Window], Mapping[str, float]]], dt: int, questions: int
) -> dict[int, dict[str, Took]]:
    """Ask several sizes in turns, so that whatever else the machine does meets them alike.

    They take turns in lots: each finds in the processor's caches what it read just before.

    Args:
        asking: By samples: what asks for a window, and gives seconds by way.
        dt: Between two samples, in ns.
        questions: How many at each size.
    """
    drawn = {size: list(windows(size * dt, questions)) for size in asking}
    took: dict[int, dict[str, list[float]]] = {size: defaultdict(list) for size in asking}
    for first in range(0, questions + _WARMING, _WARMING):
        for size, ask in asking.items():
            for window in drawn[size][first : first + _WARMING]:
                for way, seconds in ask(window).items():
                    took[size][way].append(seconds)
    return {size: {way: Took.of(each) for way, each in ways.items()} for size, ways in took.items()}


def ask_store(store: Store, window: Window, *, processor: bool) -> dict[str, float]:
    """From a read transaction's beginning to the hulls."""
    clock = time.thread_time if processor else time.perf_counter
    begun = clock()
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        read_series(connection, row, window, points=POINTS)
    return {IN_STORE: clock() - begun}


def ask_service(
    service: Service, client: httpx.Client, window: Window, *, processor: bool
) -> dict[str, float]:
    """From a client's request to the last byte of the answer; or what the cloud worked for it."""
    assert service.process is not None
    clock = partial(_worked, service.process.pid) if processor else time.perf_counter
    query = {"start": str(window.start), "end": str(window.end), "points": str(POINTS)}
    took = {}
    for name, media in FORMATS.items():
        begun = clock()
        answer = client.get(
            f"/api/v1/series/{NODE}/{CHANNEL}", params=query, headers={"Accept": media}
        )
        took[name] = clock() - begun
        answer.raise_for_status()
    return took


def _worked(process: int) -> float:
    """Seconds that all threads of a process were on a processor (Linux, ``schedstat``)."""
    threads = Path(f"/proc/{process}/task").glob("*/schedstat")
    return sum(int(each.read_text().split()[0]) for each in threads) / 1e9
