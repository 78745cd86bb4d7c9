"""An empty window is valid and has no samples."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Final

import pyarrow as pa
import pyarrow.parquet
import pytest

from tests.unit.cloud.clouds import problem, put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, peak, stretch
from tests.unit.cloud.test_client import Way, connected

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

OTHER: Final = "t02.capacitance"
SERIES: Final = f"/api/v1/series/{NODE}/{CHANNEL}"
EVENTS: Final = "/api/v1/events"
EXPORT: Final = "/api/v1/export"
BEHIND: Final = START + 1000 * DT
INSTANTS: Final = (START - 1, START, START + 1, START + 9 * DT, BEHIND)
"""Before all samples, at one, between two, at the last, and behind."""

NEVER: Final = {"time_s": {"lo": 0.0, "hi": 0.0}, "unknown_s": 0.0}
NONE: Final[dict[str, Any]] = {"items": [], "next": None}
COUNTS: Final = {"entries": {"lo": 0, "hi": 0}}
BESIDE: Final = {"other": f"{NODE}/{OTHER}"}
BAND: Final = {"model": "constant", "parameter": "value:0:1"}
SWING: Final = {
    "model": "alternating_capacitance",
    "parameter": ["minimum_capacitance:9e-12", "maximum_capacitance:1e-10", "frequency:2"],
}

QUESTIONS: Final[tuple[tuple[str, dict[str, Any], dict[str, Any]], ...]] = (
    (SERIES, {}, {"t": [], "lo": [], "hi": [], "resolution": "sample", "unit": "F"}),
    (SERIES, {"points": 1}, {"t": [], "lo": [], "hi": []}),
    (f"{SERIES}/threshold", {"above": 0}, NONE),
    (f"{SERIES}/threshold", {"at_least": 0, "at_most": 9, "outside": True}, NONE),
    (f"{SERIES}/time", {"above": 0}, NEVER | COUNTS),
    (f"{SERIES}/comparison", BESIDE, NONE),
    (f"{SERIES}/comparison/time", BESIDE, NEVER | COUNTS),
    (f"{SERIES}/anomalies", BAND, NONE),
    (f"{SERIES}/anomalies", SWING, NONE),
    (f"{SERIES}/anomalies/time", BAND, NEVER | COUNTS),
    (f"{SERIES}/anomalies/time", SWING, NEVER | COUNTS),
    (f"{SERIES}/prediction", BAND, {"t": [], "lo": [], "hi": []}),
    (f"{SERIES}/prediction", SWING, {"t": [], "lo": [], "hi": []}),
    (EVENTS, {}, NONE),
    (EVENTS, {"node": NODE, "kind": "peak", "order": "asc"}, NONE),
)


@pytest.fixture
def filled(stand: Stand) -> Stand:
    """Two channels of ten samples, and a peak that lasts as long."""
    values = [2.0] * 10, [3.0] * 10
    stated = peak(2, time=(START - 5, START + 20 * DT))
    put(stand.cloud.store, stretch(0, *values), stretch(1, *values, channel=OTHER), stated)
    return stand


async def test_nothing_is_in_an_empty_window(filled: Stand, subtests: pytest.Subtests) -> None:
    for path, asked, expected in QUESTIONS:
        with subtests.test(f"{path} {asked}"):
            for instant in INSTANTS:
                answer = await filled.get(path, **asked, start=instant, end=instant)
                assert answer.status_code == 200, answer.text
                said = answer.json()
                assert {name: said[name] for name in expected} == expected
            answer = await filled.get(path, **asked, start=START + 1, end=START)
            assert "swap" in problem(answer, 422)


@pytest.mark.parametrize("start", [START + 5 * DT, BEHIND])
async def test_file_of_an_empty_window_has_no_rows(filled: Stand, start: int) -> None:
    asked: dict[str, Any] = {"channel": [f"{NODE}/{CHANNEL}", f"{NODE}/{OTHER}"], "start": start}
    window = asked | ({} if start == BEHIND else {"end": start})
    async with filled.client() as client:
        csv, arrow, parquet = [
            await client.get(EXPORT, params=window, headers={"Accept": media})
            for media in (
                "text/csv",
                "application/vnd.apache.arrow.stream",
                "application/vnd.apache.parquet",
            )
        ]
    assert [answer.headers["eskin-samples"] for answer in (csv, arrow, parquet)] == ["0"] * 3
    assert csv.text.splitlines() == csv.text.splitlines()[:1]
    assert csv.text.startswith('"node","channel",')
    assert pa.ipc.open_stream(arrow.content).read_all().num_rows == 0
    assert pyarrow.parquet.read_table(io.BytesIO(parquet.content)).num_rows == 0
    refused = await filled.get(EXPORT, **asked | {"start": START + 1, "end": START})
    assert "swap" in problem(refused, 422)


async def test_start_behind_all_data_asks_for_an_empty_window(filled: Stand) -> None:
    for path, asked, expected in QUESTIONS:
        if path == EVENTS:
            continue
        said = (await filled.get(path, **asked, start=BEHIND)).json()
        assert {name: said[name] for name in expected} == expected


@pytest.mark.parametrize(
    "media", ["text/csv", "application/senml+json", "application/vnd.apache.parquet"]
)
async def test_empty_series_is_written_in_every_format(filled: Stand, media: str) -> None:
    async with filled.client() as client:
        window = {"start": START, "end": START}
        answer = await client.get(SERIES, params=window, headers={"Accept": media})
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith(media)


def test_client_gives_no_tube_of_an_empty_window(filled: Stand) -> None:
    with connected(filled, Way(filled)) as client:
        assert client.series(NODE, CHANNEL, start=START, end=START) == []
