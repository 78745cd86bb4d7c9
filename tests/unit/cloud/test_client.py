"""`eskin.connect`: a cloud's data as tubes, whole though the network is not."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import httpx
import numpy as np
import pytest
from eskin_cloud.access import Scope, create_token

import eskin
from eskin.errors import CloudError, QueryError
from tests.unit.cloud.clouds import put
from tests.unit.cloud.live_monitors import Live
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, status, stretch
from tests.unit.cloud.skins import HAND, PATCHES, describe, frame

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.client import Client
    from tests.unit.cloud.clouds import Stand

INF = float("inf")


class Way(httpx.BaseTransport):
    """To the cloud and back, in this process; what is asked is kept, and faults can be put in."""

    def __init__(self, stand: Stand) -> None:
        self.asked: list[httpx.URL] = []
        self.faults: dict[int, Callable[[], httpx.Response]] = {}
        self._stand = stand

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        self.asked.append(request.url)
        fault = self.faults.pop(len(self.asked), None)
        return asyncio.run(self._pass(request)) if fault is None else fault()

    async def _pass(self, request: httpx.Request) -> httpx.Response:
        async with self._stand.client(token="") as client:
            answer = await client.request(
                request.method,
                str(request.url),
                headers=request.headers.multi_items(),
                content=request.read(),
            )
        return httpx.Response(answer.status_code, headers=answer.headers, content=answer.content)


@pytest.fixture
def way(stand: Stand) -> Way:
    return Way(stand)


def connected(stand: Stand, way: Way, *, page: int = 10) -> Client:
    return eskin.connect(
        "http://localhost:8080", stand.token, page=page, retry_s=0.0, transport=way
    )


def lost() -> httpx.Response:
    raise httpx.ReadError("connection lost")


def fill(stand: Stand, *, frames: int = 5) -> None:
    """Frames of ten samples that follow each other, the third missing."""
    for k in range(frames):
        if k != 2:
            first = START + k * 10 * DT
            lo = np.arange(10.0) + 10 * k
            put(stand.cloud.store, stretch(k, lo, lo + 0.5, time=(first - 8, first + 2 * k)))


def test_series_are_tubes_that_enclose_samples_and_instants(stand: Stand, way: Way) -> None:
    fill(stand)
    with connected(stand, way) as client:
        one, two = client.series(NODE, CHANNEL)
    assert [len(one), len(two)] == [20, 20]
    assert one.values.inf.tolist() == list(np.arange(20.0))
    assert two.values.sup.tolist() == list(np.arange(30.0, 50.0) + 0.5)
    # What either frame knew of the time holds: the hull of both, seen from the first sample.
    assert one.time == (START - 8, START + 2)
    assert two.time == (START + 30 * DT - 8, START + 30 * DT + 8)
    assert (one.unit, one.dt, one.coverage) == ("F", DT, 1.0)
    assert len(way.asked) == 4


def test_frames_are_arrays_of_the_layouts_taxels(stand: Stand, way: Way) -> None:
    describe(stand.cloud.store, HAND, *PATCHES)
    put(stand.cloud.store, *(frame(k, at=20_000_000 * k, seed=k) for k in range(5)))
    with connected(stand, way) as client:
        pictures = client.frames(NODE, start=START, end=START + 10**8, points=4)
        layout = client.layout(NODE, pictures.layout)
        warm = client.frames(NODE, start=START, end=START + 10**8, quantity="temperature")
    palm, tip = layout["patches"][0], layout["patches"][2]
    assert pictures.taxels == (*palm["taxels"], *tip["taxels"])
    assert (pictures.quantity, pictures.unit, len(pictures)) == ("pressure", "Pa", 4)
    assert pictures.t.tolist() == [START + k * 25_000_000 for k in range(4)]
    assert pictures.lo.shape == pictures.hi.shape == (4, 5)
    assert np.isfinite(pictures.lo[:, :3]).all()
    assert (pictures.lo[:, :3] < pictures.hi[:, :3]).all()
    assert np.isinf(pictures.lo[:, 3:]).all(), "no frame has the page of the tip"
    assert pictures.contact is None
    assert (warm.taxels, warm.unit) == (("warm-0",), "Cel")


def test_window_without_frames_has_unknown_pictures(stand: Stand, way: Way) -> None:
    describe(stand.cloud.store, HAND, *PATCHES)
    put(stand.cloud.store, frame(0))
    with connected(stand, way) as client:
        pictures = client.frames(NODE, start=START - 10**9, end=START - 10**8, points=3)
        assert np.isinf(pictures.hi).all()
        assert len(client.frames(NODE, start=START, end=START)) == 0


def test_lost_connections_and_refusals_in_passing_leave_no_hole(stand: Stand, way: Way) -> None:
    fill(stand)
    whole = connected(stand, way).series(NODE, CHANNEL)
    busy = httpx.Response(503, json={"detail": "busy"})
    way.faults = {len(way.asked) + 1: lost, len(way.asked) + 3: lambda: busy,
                  len(way.asked) + 4: lost}  # fmt: skip
    again = connected(stand, way).series(NODE, CHANNEL)
    assert not way.faults
    assert [tube.values.inf.tolist() for tube in again] == [
        tube.values.inf.tolist() for tube in whole
    ]


def test_cloud_that_stays_away_is_an_error_that_says_so(stand: Stand, way: Way) -> None:
    way.faults = dict.fromkeys(range(1, 7), lost)
    with pytest.raises(CloudError, match="connection lost"):
        connected(stand, way).nodes()


def test_window_and_missing_samples(stand: Stand, way: Way) -> None:
    put(stand.cloud.store, stretch(0, [1.0, -INF, 3.0], [2.0, INF, INF]))
    client = connected(stand, way)
    (whole,) = client.series(NODE, CHANNEL)
    assert whole.values.inf.tolist() == [1.0, -INF, 3.0]
    assert whole.values.sup.tolist() == [2.0, INF, INF]
    start = datetime.fromtimestamp(START // 10**9, UTC)
    (part,) = client.series(NODE, CHANNEL, start=start, end=START + DT)
    assert part.values.inf.tolist() == [1.0]
    assert client.series(NODE, CHANNEL, start="2020-01-01T00:00:00Z", end=START) == []
    with pytest.raises(QueryError, match="time zone"):
        client.series(NODE, CHANNEL, start=datetime(2020, 1, 1))  # noqa: DTZ001 - that is the fault


def test_pieces_come_while_later_pages_are_not_asked_for(stand: Stand, way: Way) -> None:
    fill(stand)
    pieces = connected(stand, way).pieces(NODE, CHANNEL)
    assert len(next(pieces)) == 10
    assert len(way.asked) == 1
    assert sum(len(tube) for tube in pieces) == 30


def test_progress_is_shown_where_it_is_wanted(
    stand: Stand, way: Way, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(stand)
    client = connected(stand, way)
    client.series(NODE, CHANNEL)
    assert capsys.readouterr().err == ""
    client.series(NODE, CHANNEL, progress=True)
    said = capsys.readouterr().err
    assert "40/40" in said
    assert CHANNEL in said


def test_nodes_and_channels_are_listed(stand: Stand, way: Way) -> None:
    put(stand.cloud.store, status(0), stretch(1))
    client = connected(stand, way)
    assert [node["id"] for node in client.nodes()] == [NODE]
    assert [channel["id"] for channel in client.channels(NODE)] == [CHANNEL]


def test_refusal_states_the_status_and_the_remedy(stand: Stand, way: Way) -> None:
    with pytest.raises(CloudError, match="GET /api/v1/nodes lists all") as refused:
        connected(stand, way).series("palm", CHANNEL)
    assert refused.value.status == 404
    assert len(way.asked) == 1


@pytest.mark.parametrize("url", ["http://cloud.example:8080", "http://192.0.2.1", "cloud"])
def test_token_never_goes_in_the_clear(url: str) -> None:
    with pytest.raises(QueryError, match="https"):
        eskin.connect(url, "token")


def test_monitor_is_defined_and_its_alarms_are_read(stand: Stand, way: Way) -> None:
    put(stand.cloud.store, stretch(0, [1.0], [1.5]))
    token = create_token(
        stand.cloud.store,
        scopes=[Scope.READ, Scope.OPERATE],
        name="robot",
        lifetime=timedelta(hours=1),
    )
    stand.clock.now = START
    with eskin.connect("http://localhost:8080", token, retry_s=0.0, transport=way) as client:
        made = client.define_monitor("squeeze", f"{CHANNEL} > 2 F", node=NODE, severity="high")
        assert client.monitors() == [made]
        assert client.node_monitors(NODE) == []
        live = Live(stand.cloud.store)
        at = START + DT
        put(stand.cloud.store, stretch(1, [4.0] * 3, [5.0] * 3, time=(at, at)))
        live.step()
        (alarm,) = client.alarms(monitor="squeeze", state="raised")
        assert (alarm["severity"], alarm["verdict"]) == ("high", "certain")
        assert client.alarms(state="cleared") == []
        with pytest.raises(CloudError, match="422"):
            client.define_monitor("squeeze", f"{CHANNEL} > 2 Pa", node=NODE)
