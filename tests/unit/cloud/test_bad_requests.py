"""Bad questions: always problem details that say what to do."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.access import create_token
from eskin_cloud.api.responses import choose

from tests.unit.cloud.clouds import problem, put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"
THRESHOLD = f"{SERIES}/threshold"
TIME = f"{SERIES}/time"

BAD_QUESTIONS: tuple[tuple[str, dict[str, Any], int, str], ...] = (
    (SERIES, {"start": "2027-01-02T00:00:00Z", "end": "2027-01-01T00:00:00Z"}, 422, "swap"),
    (
        SERIES,
        {"start": 5, "end": "1970-01-01T00:00:00Z"},
        422,
        "start: 1970-01-01T00:00:00.000000005Z is after end, 1970-01-01T00:00:00.000000000Z",
    ),
    (SERIES, {"start": "yesterday"}, 422, "RFC 3339"),
    (SERIES, {"start": "2027-13-01T00:00:00Z"}, 422, "start"),
    (SERIES, {"start": "2027-01-01T00:00:00"}, 422, "RFC 3339"),
    (SERIES, {"start": "nan"}, 422, "RFC 3339"),
    (SERIES, {"start": "1e18"}, 422, "RFC 3339"),
    (SERIES, {"end": "9" * 20}, 422, "2262"),
    (SERIES, {"end": "9" * 99}, 422, "RFC 3339"),
    (SERIES, {"end": "9999-12-31T23:59:59Z"}, 422, "2262"),
    (SERIES, {"start": "0001-01-01T00:00:00Z"}, 422, "1678"),
    (SERIES, {"start": "1700-01-01T00:00:00Z", "end": "2200-01-01T00:00:00Z"}, 422, "146 years"),
    (SERIES, {"end": "2" * 101}, 422, "end"),
    (SERIES, {"points": 0}, 422, "points"),
    (SERIES, {"points": 20_001}, 422, "points"),
    (SERIES, {"points": "many"}, 422, "points"),
    (SERIES, {"points": 1.5}, 422, "points"),
    (SERIES, {"pionts": 5}, 422, "spelling"),
    (SERIES, {"": ""}, 422, "parameter"),
    (f"/api/v1/series/{NODE}/t99.nothing", {}, 404, "channels lists"),
    (f"/api/v1/series/unknown/{CHANNEL}", {}, 404, "nodes lists"),
    ("/api/v1/series/%00/%ff", {}, 404, "nodes lists"),
    (f"/api/v1/series/unknown/{CHANNEL}/threshold", {"above": 1}, 404, "nodes lists"),
    (THRESHOLD, {}, 422, "above, below: give either above or below"),
    (THRESHOLD, {"above": 1, "below": 2}, 422, "above, below: give either above or below"),
    (THRESHOLD, {"above": "nan"}, 422, "above"),
    (THRESHOLD, {"below": "inf"}, 422, "below"),
    (THRESHOLD, {"below": "x"}, 422, "below"),
    (THRESHOLD, {"above": 1, "limit": 0}, 422, "limit"),
    (THRESHOLD, {"at_least": 1}, 422, "give both ends"),
    (THRESHOLD, {"at_least": 2, "at_most": 1}, 422, "swap"),
    (THRESHOLD, {"at_least": 1, "at_most": 2, "above": 3}, 422, "either above or below"),
    (THRESHOLD, {"above": 1, "outside": True}, 422, "give at_least and at_most"),
    (TIME, {}, 422, "either above or below"),
    (TIME, {"above": "nan"}, 422, "above"),
    (TIME, {"above": 1, "start": 5, "end": 4}, 422, "swap"),
    (TIME, {"above": 1, "cursor": "x"}, 422, "spelling"),
    (THRESHOLD, {"above": 1, "cursor": "?"}, 422, "cursor"),
    (THRESHOLD, {"above": 1, "cursor": "MQ"}, 422, "cursor"),
    (THRESHOLD, {"above": 1, "start": 5, "end": 4}, 422, "swap"),
    ("/api/v1/nodes", {"cursor": "ü"}, 422, "cursor"),
    ("/api/v1/nodes", {"limit": 5}, 422, "spelling"),
    ("/api/v1/nodes/unknown", {}, 404, "nodes lists"),
    ("/api/v1/nodes/unknown/channels", {}, 404, "nodes lists"),
    (f"/api/v1/nodes/{NODE}", {"x": 1}, 422, "spelling"),
    ("/api/v1/events", {"kind": "earthquake"}, 422, "kind"),
    ("/api/v1/events", {"verdict": "unlikely"}, 422, "verdict"),
    ("/api/v1/events", {"order": "random"}, 422, "order"),
    ("/api/v1/events", {"limit": 1001}, 422, "limit"),
    ("/api/v1/events", {"start": 2, "end": 1}, 422, "swap"),
    ("/api/v1/events", {"cursor": "MTIzCjk5OTk5OTk5OTk5OTk5OTk5OTk5"}, 422, "cursor"),
    ("/api/v1/events", {"cursor": "x" * 1001}, 422, "cursor"),
    ("/api/v1/events", {"node": "unknown"}, 404, "nodes lists"),
    ("/api/v1/live", {"node": "unknown"}, 404, "nodes lists"),
    ("/api/v1/live", {"channel": f"unknown/{CHANNEL}"}, 404, "nodes lists"),
    ("/api/v1/live", {"points": 0}, 422, "points"),
    ("/api/v1/live", {"grain": -1}, 422, "grain"),
    ("/api/v1/live", {"channel": "/"}, 422, "NODE/CHANNEL"),
    ("/api/v1/nothing", {}, 404, "openapi"),
    ("/api/v2/nodes", {}, 404, "openapi"),
)


async def test_bad_question_is_refused_with_what_to_do(
    stand: Stand, subtests: pytest.Subtests
) -> None:
    put(stand.cloud.store, stretch(0))
    for path, params, status, says in BAD_QUESTIONS:
        with subtests.test(f"{path} {params}"):
            assert says in problem(await stand.get(path, **params), status)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
async def test_other_method_is_refused(stand: Stand, method: str) -> None:
    async with stand.client() as client:
        answer = await client.request(method, "/api/v1/nodes")
    problem(answer, 405)
    assert answer.headers["allow"] == "GET"


async def test_internal_error_shows_no_traceback(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise RuntimeError("secret inside")

    monkeypatch.setattr("eskin_cloud.api.nodes.list_nodes", fails)
    answer = await stand.get("/api/v1/nodes")
    problem(answer, 500)
    assert "secret" not in answer.text


async def test_threshold_pages_hold_each_segment_once(stand: Stand) -> None:
    low = np.random.default_rng(5).choice([0.0, 1.0, 2.0], 200)
    put(stand.cloud.store, stretch(0, low, low + 1))
    whole = (await stand.get(THRESHOLD, above=1.5)).json()
    assert whole["next"] is None
    paged: list[Any] = []
    cursor: dict[str, str] = {}
    while True:
        page = (await stand.get(THRESHOLD, above=1.5, limit=7, **cursor)).json()
        paged += page["items"]
        if page["next"] is None:
            break
        cursor = {"cursor": page["next"]}
    assert paged == whole["items"]
    assert len({item["start"] for item in paged}) == len(paged) > 20


async def test_totals_carry_the_union_bound_of_all_samples(stand: Stand) -> None:
    put(stand.cloud.store, stretch(0, np.full(100, 2.0), np.full(100, 3.0), coverage=0.999))
    window = {"above": 1.5, "start": START, "end": START + 99 * DT}
    (piece,) = (await stand.get(THRESHOLD, **window)).json()["items"]
    assert piece["verdict"] == "certain"
    assert 0.997 < piece["coverage"] <= 0.999  # in its middle
    assert 0.8999 < (await stand.get(TIME, **window)).json()["coverage"] <= 0.9


async def test_time_in_a_band_is_an_interval_and_gaps_are_unknown(stand: Stand) -> None:
    later = START + 7 * DT
    put(
        stand.cloud.store,
        stretch(0, [1.0, 1.0, 2.5, 9.0], [2.0, 2.0, 3.5, 9.5]),
        stretch(1, [1.0], [2.0], time=(later, later)),
        stretch(2, [9.0], [9.5], time=(later + 5 * DT, later + 5 * DT)),
    )
    band = {"at_least": 1, "at_most": 3, "start": START, "end": START + 10 * DT}
    found = (await stand.get(TIME, **band)).json()
    assert found["time_s"]["lo"] == pytest.approx(0.003)
    assert Fraction(found["time_s"]["lo"]) <= Fraction(3, 1000)
    assert found["time_s"]["hi"] == pytest.approx(0.004)
    assert Fraction(found["time_s"]["hi"]) >= Fraction(4, 1000)
    assert found["unknown_s"] == pytest.approx(0.005)
    assert found["entries"] == {"lo": 2, "hi": 2}
    listed = (await stand.get(THRESHOLD, **band, outside=True)).json()["items"]
    assert [item["verdict"] for item in listed] == ["possible", "certain"]


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        (None, "application/json"),
        ("", "application/json"),
        ("*/*", "application/json"),
        ("text/*", "text/csv"),
        ("text/html, */*;q=0.1", "application/json"),
        ("application/json;q=0.5, text/csv", "text/csv"),
        ("application/json;q=0, */*", "text/csv"),
        ("TEXT/CSV; charset=utf-8", "text/csv"),
        ("text/csv;q=0", None),
        ("text/csv;q=x", None),
        ("image/png", None),
        (",;,", None),
    ],
)
def test_accept_chooses_a_format(accept: str | None, chosen: str | None) -> None:
    assert choose(accept, ("application/json", "text/csv")) == chosen


async def test_token_without_scopes_opens_nothing(stand: Stand) -> None:
    token = create_token(stand.cloud.store, scopes=[], name="x", lifetime=None)
    async with stand.client(token=token) as client:
        problem(await client.get("/api/v1/nodes"), 403)
