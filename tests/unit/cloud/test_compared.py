"""Comparisons and predictions over HTTP, and by the client."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import pytest

from eskin.errors import CloudError
from eskin.interval import Interval
from tests.unit.cloud.clouds import problem, put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch
from tests.unit.cloud.test_client import Way, connected

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

OTHER = "t02.capacitance"
COMPARISON = f"/api/v1/series/{NODE}/{CHANNEL}/comparison"


def fill(stand: Stand) -> None:
    """One channel above the other, then near, then below, then one ends."""
    lo = [5.0] * 10 + [2.5] * 10 + [0.0] * 10
    put(stand.cloud.store, stretch(0, lo, [each + 0.6 for each in lo]))
    put(stand.cloud.store, stretch(1, [2.0] * 8, [3.0] * 8, dt=5 * DT, channel=OTHER))
    put(stand.cloud.store, stretch(2, [2.0], [3.0], channel="t01.inductance", unit="H"))


def asked(**more: Any) -> dict[str, Any]:
    return {"other": f"{NODE}/{OTHER}", "start": START, "end": START + 50 * DT} | more


@pytest.mark.anyio
async def test_comparison_states_when_and_for_how_long(stand: Stand) -> None:
    fill(stand)
    async with stand.client() as client:
        above = (await client.get(COMPARISON, params=asked())).json()
        below = (await client.get(COMPARISON, params=asked(state="below"))).json()
        total = (await client.get(f"{COMPARISON}/time", params=asked())).json()
        first = (await client.get(COMPARISON, params=asked(limit=1))).json()
        rest = (await client.get(COMPARISON, params=asked(cursor=first["next"]))).json()
    starts = ["2027-01-15T08:00:00.000000000Z", "2027-01-15T08:00:00.010000000Z"]
    assert [each["start"] for each in above["items"]] == starts
    assert [each["end"] for each in above["items"]] == [starts[1], starts[1].replace(".01", ".02")]
    assert [each["verdict"] for each in above["items"]] == ["certain", "possible"]
    assert [each["verdict"] for each in below["items"]] == ["possible", "certain"]
    assert first["items"] + rest["items"] == above["items"]
    assert rest["next"] is None
    assert total["time_s"] == pytest.approx({"lo": 0.01, "hi": 0.02})
    assert total["unknown_s"] == pytest.approx(0.02 + 0.001)  # after the last sample's instant
    assert total["entries"]["lo"] == 1
    assert 6 <= total["entries"]["hi"] <= 8
    assert total["coverage"] == 1.0


@pytest.mark.anyio
async def test_without_a_window_it_is_the_last_minute_that_both_have(stand: Stand) -> None:
    fill(stand)
    async with stand.client() as client:
        found = (await client.get(f"{COMPARISON}/time", params={"other": asked()["other"]})).json()
    assert found["end"] == "2027-01-15T08:00:00.029000001Z"


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("change", "status", "said"),
    [
        ({"other": OTHER}, 422, "NODE/CHANNEL"),
        ({"other": f"{NODE}/t01.inductance"}, 422, "units do not fit"),
        ({"other": f"{NODE}/t99.nothing"}, 404, "channels lists"),
        ({"other": f"unknown/{CHANNEL}"}, 404, "nodes lists"),
        ({"state": "beside"}, 422, "above"),
        ({"start": START + 51 * DT}, 422, "swap"),
        ({"cursor": "x"}, 422, "cursor"),
    ],
)
async def test_bad_comparisons_are_refused(
    stand: Stand, change: dict[str, Any], status: int, said: str
) -> None:
    fill(stand)
    async with stand.client() as client:
        assert said in problem(await client.get(COMPARISON, params=asked(**change)), status)


def test_client_asks_for_comparisons(stand: Stand) -> None:
    fill(stand)
    start = datetime(2027, 1, 15, 8, tzinfo=UTC)
    with connected(stand, Way(stand)) as client:
        found = client.comparison(NODE, CHANNEL, f"{NODE}/{OTHER}", state="below", start=start)
        total = client.comparison_time(NODE, CHANNEL, f"{NODE}/{OTHER}", start=start)
    assert [each["verdict"] for each in found] == ["possible", "certain"]
    assert total["time_s"] == pytest.approx({"lo": 0.01, "hi": 0.02})


def test_client_asks_for_anomalies(stand: Stand) -> None:
    fill(stand)
    band = {"value": Interval(2.0, 6.0)}
    window = {"start": START, "end": START + 30 * DT}
    with connected(stand, Way(stand)) as client:
        found = client.anomalies(NODE, CHANNEL, "constant", band, **window)
        total = client.anomalies_time(NODE, CHANNEL, "constant", band, **window)
        tube = client.prediction(NODE, CHANNEL, "constant", {"value": 2.5}, points=3, **window)
        with pytest.raises(CloudError, match="value is missing"):
            client.anomalies(NODE, CHANNEL, "constant", {})
    assert [each["verdict"] for each in found] == ["certain"]
    assert total["time_s"]["lo"] == pytest.approx(0.009)  # until the last sample's instant
    assert (tube["lo"], tube["hi"], tube["unit"]) == ([2.5] * 3, [2.5] * 3, "F")
