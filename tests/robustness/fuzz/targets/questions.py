"""Questions about what is stored: any parameters, over the whole application."""

from __future__ import annotations

import json
from contextlib import ExitStack
from typing import TYPE_CHECKING, Final
from urllib.parse import quote

import numpy as np
from eskin_cloud.rollup.patch_tile_builder import build

from eskin.monitor.predicted_quantities import DEFAULTS
from tests.robustness.fuzz.mutations.queries import OTHER, mutate_query
from tests.robustness.fuzz.people import People, require_intervals
from tests.robustness.fuzz.target import Target
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, gap, peak, status, stretch

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.store import Store

_SAMPLES: Final = 50
_FRAMES: Final = 40
_SERIES: Final = f"api/v1/series/{NODE}/{CHANNEL}"
_ALL: Final = f"start={START}&end={START + 10**10}"
_SWING: Final = "&".join(
    f"parameter={name}:{lo}:{hi}"
    for name, (lo, hi) in {**DEFAULTS["alternating_capacitance"], "frequency": (2.0, 2.0)}.items()
)
_PREDICTED: Final = f"model=alternating_capacitance&{_SWING}&{_ALL}"
_FORMULA: Final = quote(f"once[0,50ms]({CHANNEL} > 1.5) and delay({CHANNEL}, 20ms) < {OTHER}")
_ANOMALY: Final = quote(f"outside({CHANNEL}, constant(value = [1.2, 1.5])) > 0")
_ASKED: Final = (
    f"{_SERIES}?{_ALL}&points=100",
    f"{_SERIES}?points=2\ntext/csv",
    f"{_SERIES}?{_ALL}\napplication/vnd.apache.arrow.stream",
    f"{_SERIES}?{_ALL}\napplication/senml+json",
    f"{_SERIES}/threshold?{_ALL}&above=1.5&limit=3",
    f"{_SERIES}/threshold?at_least=1.2&at_most=1.6&outside=true",
    f"{_SERIES}/time?{_ALL}&below=1.5",
    f"{_SERIES}/comparison?other={NODE}/{OTHER}&state=below&{_ALL}&limit=5",
    f"api/v1/monitors/evaluation?node={NODE}&{_ALL}&limit=5&formula={_FORMULA}",
    f"api/v1/monitors/evaluation/time?node={NODE}&{_ALL}&formula={_FORMULA}",
    f"api/v1/monitors/evaluation?node={NODE}&{_ALL}&formula={_ANOMALY}",
    f"api/v1/monitors/evaluation?formula=%22{NODE}/{OTHER}%22+%3E+1.5&verdict=possible",
    f"{_SERIES}/comparison/time?other={NODE}/{OTHER}&{_ALL}",
    f"{_SERIES}/prediction?{_PREDICTED}&points=20",
    f"{_SERIES}/anomalies?{_PREDICTED}&origin={START}&limit=2",
    f"{_SERIES}/anomalies/time?model=constant&parameter=value:1:2&{_ALL}",
    f"api/v1/export?channel={NODE}/{CHANNEL}&channel={NODE}/{OTHER}&{_ALL}&limit=100\ntext/csv",
    f"api/v1/export?channel={NODE}/{OTHER}\napplication/vnd.apache.parquet",
    f"api/v1/events?node={NODE}&kind=peak&order=asc&limit=2&{_ALL}",
    f"api/v1/live?channel={NODE}/{CHANNEL}&points=3",
    "api/v1/nodes?limit=1",
    f"api/v1/nodes/{NODE}/channels",
    f"api/v1/nodes/{NODE}/taxels",
)
_LONGEST: Final = 2048


def make(folder: Path) -> Target:
    """The input is a target, and perhaps a line with what is accepted; bounds are in order."""
    stack = ExitStack()
    people = People(folder, stack)
    _fill(people.store)

    def check(data: bytes) -> None:
        target, _, accepted = data.partition(b"\n")
        headers = [(b"accept", accepted)] if accepted else []
        answer = people.ask("GET", target, headers, b"")
        if answer.headers.get(b"content-type") == b"application/json":
            require_intervals(json.loads(answer.body))

    return Target(tuple(seed.encode() for seed in _ASKED), mutate_query, check, stack, _LONGEST)


def _fill(store: Store) -> None:
    """Two channels with pyramids: one even, one with overlaps, gaps and wide times."""
    draw = np.random.default_rng(1)
    for number in range(_FRAMES):
        begin = START + number * _SAMPLES * DT
        lo, time = 1.0 + draw.random(_SAMPLES), (begin, begin)
        put(store, stretch(2 * number, lo, lo + 0.25, time=time))
        if number % 5:
            early = begin + (number % 3 - 1) * 10 * DT
            time = early, early + 3 * DT
            put(store, stretch(2 * number + 1, lo + 0.1, lo + 0.3, channel=OTHER, time=time))
    compact_all(store)
    build(store)
    put(store, status(0, boot=2), peak(1, boot=2), gap(2, boot=2))
