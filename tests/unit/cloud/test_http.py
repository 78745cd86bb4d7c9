"""The whole way over HTTP: ingest, store, series, events, nodes."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.parquet
import pytest

from eskin.interval import Verdict
from eskin.wire.messages import Energy, Shedding, TaxelFaults
from tests.unit.cloud.clouds import batch, numbers, problem, put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, gap, peak, skin_of, status, stretch
from tests.unit.eskin.senml import read_senml

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"


async def test_ingest_answers_each_item_in_order(stand: Stand) -> None:
    body = batch(stretch(0), stretch(0), stretch(1, unit="H"), status(2))
    answer = await stand.ingest(body)
    assert answer.status_code == 200, answer.text
    items = answer.json()["items"]
    assert [item["result"] for item in items] == ["stored", "duplicate", "rejected", "stored"]
    assert "'F'" in items[2]["reason"]
    assert items[0]["reason"] is None


async def test_series_gives_exact_samples(stand: Stand) -> None:
    lo = [0.125, 1e-9, float("-inf"), float("-inf")]
    hi = [0.25, 3.0, 5.0, float("inf")]
    said = stretch(0, lo, hi, time=(START - 4, START + 5))
    await stand.ingest(batch(said))
    answer = await stand.get(SERIES)
    assert answer.json() == {
        "node": NODE,
        "channel": CHANNEL,
        "unit": "F",
        "coverage": 1.0,
        "resolution": "sample",
        "t0": "2027-01-15T08:00:00.000000000Z",
        "t": [0, DT, 2 * DT, 3 * DT],
        "lo": [0.125, float(said.values[0].inf[1, 0]), None, None],
        "hi": [0.25, 3.0, 5.0, None],
        "mean": None,
        "dt": DT,
        "time_error": 5,
    }


async def test_formats_agree(stand: Stand) -> None:
    lo, hi = [0.125, float("-inf"), float("-inf")], [0.25, 5.0, float("inf")]
    put(stand.cloud.store, stretch(0, lo, hi))
    async with stand.client() as client:
        answers = {
            media: await client.get(SERIES, headers={"Accept": media})
            for media in (
                "text/csv",
                "application/vnd.apache.arrow.stream",
                "application/vnd.apache.parquet",
            )
        }
    for media, answer in answers.items():
        assert answer.headers["content-type"].partition(";")[0] == media
    rows = list(csv.DictReader(io.StringIO(answers["text/csv"].text)))
    assert rows[0] == {"time": "2027-01-15T08:00:00.000000000Z", "lo": "0.125", "hi": "0.25"}
    assert [(row["lo"], row["hi"]) for row in rows[1:]] == [("-inf", "5.0"), ("", "")]
    arrow = pa.ipc.open_stream(answers["application/vnd.apache.arrow.stream"].content).read_all()
    parquet = pyarrow.parquet.read_table(
        io.BytesIO(answers["application/vnd.apache.parquet"].content)
    )
    for table in (arrow, parquet):
        assert table["time"].cast(pa.int64()).to_pylist() == [START, START + DT, START + 2 * DT]
        assert table["lo"].to_pylist() == [0.125, float("-inf"), None]
        assert table["hi"].to_pylist() == [0.25, 5.0, None]
        assert table.schema.metadata[b"unit"] == b"F"


async def test_senml_states_known_bounds_and_what_holds_for_all(stand: Stand) -> None:
    lo, hi = [0.125, float("-inf"), float("-inf")], [0.25, 5.0, float("inf")]
    put(stand.cloud.store, stretch(0, lo, hi, time=(START - 4, START + 5)))
    async with stand.client() as client:
        plain = await client.get(SERIES, headers={"Accept": "application/senml+json"})
        short = await client.get(SERIES, headers={"Accept": "application/senml+cbor"})
        hull = await client.get(
            SERIES, params={"points": 1}, headers={"Accept": "application/senml+json"}
        )
    about = [("coverage", 1.0), ("time_error", 5e-9)]
    stated = [*about, ("lo", 0.125), ("hi", 0.25), ("hi", 5.0)]
    assert read_senml(plain.text, f"{NODE}/{CHANNEL}/") == stated
    assert read_senml(short.content, f"{NODE}/{CHANNEL}/") == stated
    first, second = (answer.headers["content-type"] for answer in (plain, short))
    assert (first, second) == ("application/senml+json", "application/senml+cbor")
    (span,) = [record for record in hull.json() if record["n"] == "span"]
    assert (span["u"], span["v"]) == ("s", 60.0)


async def test_senml_of_times_before_1978_is_refused(stand: Stand) -> None:
    put(stand.cloud.store, stretch(0, time=(5, 5)))
    async with stand.client() as client:
        answer = await client.get(SERIES, headers={"Accept": "application/senml+json"})
    assert "1978-07-04" in problem(answer, 422)


async def test_unacceptable_format_is_refused_with_what_there_is(stand: Stand) -> None:
    put(stand.cloud.store, stretch(0))
    async with stand.client() as client:
        answer = await client.get(SERIES, headers={"Accept": "image/png"})
    detail = problem(answer, 406)
    assert all(media in detail for media in ("application/json", "text/csv", "senml+json"))


async def test_nodes_tell_latest_status(stand: Stand) -> None:
    put(stand.cloud.store, status(7, boot=3), stretch(6, boot=3))
    listed = (await stand.get("/api/v1/nodes")).json()
    assert listed["next"] is None
    (node,) = listed["items"]
    assert node == {
        "id": NODE,
        "health": "online",
        "last_seen": "2027-01-15T09:00:00.000000000Z",
        "boot": 3,
        "sequence": 7,
        "profile": "fingertip",
        "description": "one finger",
        "uptime_ns": 5 * 10**9,
        "outbox": {"messages": 2, "bytes": 4096, "capacity_bytes": 1_048_576},
        "gaps": 1,
        "energy": None,
        "faults": None,
        "channels": 1,
        "lag": {"lo_ns": 3600 * 10**9, "hi_ns": 3600 * 10**9},
        "clock": {
            "verdict": "possible",
            "offset": {"lo_ns": 5 - 3601 * 10**9, "hi_ns": None},
            "references_agree": True,
        },
        "layout": skin_of()[0].content_hash.hex(),
        "missing": None,
    }
    assert (await stand.get(f"/api/v1/nodes/{NODE}")).json() == node


async def test_nodes_tell_their_energy(stand: Stand) -> None:
    stated = Energy((0.25, float("inf")), (0.5, 1.0), Verdict.POSSIBLE, Shedding.PEAKS)
    put(stand.cloud.store, replace(status(7, boot=3), energy=stated))
    (node,) = (await stand.get("/api/v1/nodes")).json()["items"]
    assert node["energy"] == {
        "stored": {"lo": 0.25, "hi": None},
        "charge": {"lo": 0.5, "hi": 1.0},
        "self_sustaining": "possible",
        "shedding": "peaks",
    }


async def test_nodes_tell_which_taxels_may_be_broken(stand: Stand) -> None:
    stated = (
        TaxelFaults("t05", Verdict.IMPOSSIBLE, Verdict.CERTAIN),
        TaxelFaults("t06", Verdict.POSSIBLE, Verdict.POSSIBLE),
    )
    put(stand.cloud.store, replace(status(7, boot=3), faults=stated))
    (node,) = (await stand.get("/api/v1/nodes")).json()["items"]
    assert node["faults"] == [
        {"taxel": "t05", "dead": "impossible", "stuck": "certain"},
        {"taxel": "t06", "dead": "possible", "stuck": "possible"},
    ]


async def test_silent_node_is_late_then_offline(stand: Stand) -> None:
    put(stand.cloud.store, stretch(0))
    health = []
    for seconds in (4.9, 0.1, 10.0):
        stand.clock.turn(seconds)
        health.append((await stand.get(f"/api/v1/nodes/{NODE}")).json()["health"])
    assert health == ["online", "late", "offline"]


async def test_channels_are_listed_with_what_their_frames_state(stand: Stand) -> None:
    brought = (
        stretch(1, [1.0, 2.0], [3.0, float("inf")]),
        stretch(2, [0.5], [0.75], time=(START + 10 * DT, START + 10 * DT), coverage=0.5),
    )
    put(stand.cloud.store, status(0), *brought)
    items = (await stand.get(f"/api/v1/nodes/{NODE}/channels")).json()["items"]
    stated = {
        "id": CHANNEL,
        "taxel": "t01",
        "quantity": "capacitance",
        "unit": "F",
        "coverage": 0.5,
        "dt": DT,
        "first": "2027-01-15T08:00:00.000000000Z",
        "last": "2027-01-15T08:00:00.010000000Z",
        "biometric": False,
        "patch": "t01-capacitance",
        "removed": None,
    }
    assert {name: items[0][name] for name in stated} == stated


async def test_channel_without_data_answers_an_empty_series(stand: Stand) -> None:
    put(stand.cloud.store, peak(0))  # it names the layout
    answer = (await stand.get(SERIES)).json()
    assert (answer["t"], answer["lo"], answer["hi"]) == ([], [], [])
    assert (await stand.get(f"{SERIES}/threshold", above=1)).json() == {"items": [], "next": None}


async def test_events_are_listed_latest_first_and_filtered(stand: Stand) -> None:
    put(
        stand.cloud.store,
        gap(1, time=(START + 50, START + 60)),
        peak(0, time=(START, START + 10)),
        status(2),
    )
    items = (await stand.get("/api/v1/events")).json()["items"]
    assert [item["kind"] for item in items] == ["gap", "status", "peak"]
    assert items[2] | {"id": ""} == {
        "id": "",
        "node": NODE,
        "channel": CHANNEL,
        "kind": "peak",
        "verdict": "certain",
        "time": {"lo": "2027-01-15T08:00:00.000000000Z", "hi": "2027-01-15T08:00:00.000000010Z"},
        "height": {"lo": 2.0, "hi": None},
        "prominence": {"lo": 0.5, "hi": 0.75},
        "count": {"lo": 1, "hi": 1},
        "unit": "F",
        "coverage": 0.875,
        "boot": 1,
        "detail": None,
    }
    for question, kinds in (
        ({"kind": "gap"}, ["gap"]),
        ({"verdict": "certain"}, ["peak"]),
        ({"channel": CHANNEL}, ["peak"]),
        ({"start": START + 55}, ["gap"]),
        ({"end": START + 50}, ["status", "peak"]),
        ({"order": "asc"}, ["peak", "status", "gap"]),
    ):
        found = (await stand.get("/api/v1/events", **question)).json()["items"]
        assert sorted(item["kind"] for item in found) == sorted(kinds), question


@pytest.mark.parametrize("order", ["asc", "desc"])
async def test_events_pages_hold_each_event_once(stand: Stand, order: str) -> None:
    put(stand.cloud.store, *(peak(n, time=(START + n // 3, START + n // 3)) for n in range(10)))
    seen: list[int] = []
    cursor = None
    while True:
        params = {"limit": 3, "order": order} | ({} if cursor is None else {"cursor": cursor})
        page = (await stand.get("/api/v1/events", **params)).json()
        seen += [number - 1 for number in numbers(int(item["id"]) for item in page["items"])]
        cursor = page["next"]
        if cursor is None:
            break
    assert seen == sorted(range(10), reverse=order == "desc")
