"""What comes between two questions, or two streams, is stated all the same."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

import pytest

from eskin.wire.timestamp import parse_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import CHART, history
from tests.unit.dashboard.frame_server import encode_message
from tests.unit.dashboard.pixels import read_plot
from tests.unit.dashboard.replay import STRETCH_NS

if TYPE_CHECKING:
    from playwright.sync_api import Request, Route, WebSocketRoute

    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.replay import Replay

SECOND = 1_000_000_000
CHANNEL = "palm/t01.energy"
QUICK = "fingertip/t01.capacitance"


def newest(replay: Replay) -> int:
    """Where the data of the quick channel end."""
    items = replay.get("/nodes/fingertip/channels")["items"]
    (channel,) = (item for item in items if item["id"] in QUICK)
    return parse_timestamp(channel["last"])


def watch(visit: Visit) -> list[WebSocketRoute]:
    """All live streams of the page, which a test may close or send more by."""
    streams: list[WebSocketRoute] = []

    def connect(stream: WebSocketRoute) -> None:
        stream.connect_to_server()
        streams.append(stream)

    visit.page.route_web_socket("**/api/v1/live?*", connect)
    return streams


def lag(stream: WebSocketRoute) -> None:
    """State that something was left out."""
    stream.send(encode_message(["lagging", "9", 7]))


def test_stream_goes_on_after_what_the_one_before_brought(visit: Visit) -> None:
    streams = watch(visit)
    visit.open(f"{CHANNEL}?live=10s")
    visit.wait_for_chart(mode="live")
    begin = visit.newest()
    wait_until(lambda: visit.newest() > begin, "frames come")
    streams[0].close()
    wait_until(lambda: bool(visit.evaluate("1") and len(streams) > 1), "there is another stream")
    first, second = (parse_qs(urlsplit(each.url).query) for each in streams[:2])
    assert "cursor" not in first
    assert int(second["cursor"][0]) >= begin // STRETCH_NS - 1


@pytest.mark.nightly
def test_window_that_was_not_over_shows_all_of_it_in_the_end(
    visit: Visit, replay: Replay, recorded: int
) -> None:
    visit.open(history(QUICK, recorded - SECOND, recorded))
    visit.wait_for_chart(mode="history")
    begin = newest(replay)
    # Sooner over than the page asks again.
    end = begin + SECOND * 3 // 2
    place = history(QUICK, begin - SECOND, end)
    visit.evaluate("(place) => { location.hash = `#/${place}`; }", place)
    wait_until(lambda: newest(replay) > end, "the window is over")

    def is_whole() -> bool:
        painted = read_plot(visit).painted
        return any(painted[-(len(painted) // 20) :])

    wait_until(is_whole, "the chart shows its end", seconds=20)


TIMES = """
() => [...document.querySelectorAll("[data-testid=event] a")].map(({ title }) =>
  title.split("\\n")[1].split(" to "))
"""


def test_events_of_a_window_of_the_past_are_those_of_the_window(
    visit: Visit, replay: Replay, recorded: int
) -> None:
    def listed() -> list[tuple[int, int]]:
        return [(parse_timestamp(lo), parse_timestamp(hi)) for lo, hi in visit.evaluate(TIMES)]

    def lie_in(start: int, end: int) -> bool:
        busy = visit.page.get_by_test_id("events").get_attribute("aria-busy")
        found = listed()
        return busy is None and bool(found) and all(lo < end and hi >= start for lo, hi in found)

    start = recorded - 8 * SECOND
    visit.open(history("", start, recorded), shows="[data-testid=event]")
    wait_until(lambda: lie_in(start, recorded), "its events are listed")
    begin = newest(replay)
    wait_until(lambda: newest(replay) > begin + 2 * SECOND, "more has come since")
    assert lie_in(start, recorded)
    visit.page.get_by_test_id("earlier").click()
    wait_until(lambda: visit.window() == (start - 4 * SECOND, recorded - 4 * SECOND), "it moves")
    wait_until(lambda: lie_in(start - 4 * SECOND, recorded - 4 * SECOND), "the list follows")
    visit.page.get_by_test_id("go-live").click()
    wait_until(lambda: max(lo for lo, _ in listed()) > recorded, "the latest are listed")


def test_overview_asks_for_events_once_for_all_its_charts(visit: Visit) -> None:
    held: list[Route] = []
    aborted: list[str] = []

    def hold(route: Route) -> None:
        held.append(route)

    def note(request: Request) -> None:
        aborted.append(request.url)

    visit.page.route("**/api/v1/nodes/*/channels?*", hold)
    visit.page.on("requestfailed", note)
    visit.open("?live=5s", shows="[data-testid=event]")
    charts = 6
    wait_until(lambda: bool(visit.evaluate("1")) and len(held) >= charts, "charts are wanted")
    visit.page.unroute("**/api/v1/nodes/*/channels?*")  # lets them go on
    wait_until(lambda: visit.page.locator(CHART).count() >= charts, "all charts are there")
    wait_until(lambda: visit.asked("kind=peak") > 0, "peaks are asked for")
    visit.wait_for_answers()
    asked = [url for url in visit.requests if "/api/v1/events?" in url]
    for kind in ("gap", "peak"):
        # Charts that open late, on a busy machine, may ask together once more.
        assert 1 <= sum(f"kind={kind}&" in f"{url}&" for url in asked) < charts / 2
    assert not [url for url in aborted if "/events?" in url]


@pytest.mark.nightly
def test_events_are_listed_again_where_the_stream_left_some_out(visit: Visit) -> None:
    lists: list[str] = []

    def count(request: Request) -> None:
        if "/api/v1/events?" in request.url and "limit=50&" in f"{request.url}&":
            lists.append(request.url)

    visit.page.on("request", count)
    streams = watch(visit)
    visit.open(f"{CHANNEL}?live=10s")
    visit.page.get_by_test_id("event").first.wait_for()
    visit.wait_for_answers()
    before = len(lists)
    lag(streams[0])
    wait_until(
        lambda: bool(visit.evaluate("1") and len(lists) > before), "they are asked for again"
    )


@pytest.mark.nightly
def test_window_of_the_past_is_asked_for_again_where_the_stream_left_some_out(
    visit: Visit, recorded: int
) -> None:
    asked: list[str] = []

    def count(request: Request) -> None:
        if "/api/v1/series/" in request.url:
            asked.append(request.url)

    visit.page.on("request", count)
    streams = watch(visit)
    visit.open(history(CHANNEL, recorded - SECOND, recorded))
    visit.wait_for_chart(mode="history")
    before = len(asked)
    lag(streams[0])
    wait_until(lambda: bool(visit.evaluate("1") and len(asked) > before), "it is asked for again")


def test_chart_of_a_stream_that_is_too_slow_is_not_emptied_and_asks_seldom(visit: Visit) -> None:
    asked: list[str] = []

    def count(request: Request) -> None:
        if "/api/v1/series/" in request.url:
            asked.append(request.url)

    def painted() -> int:
        return sum(map(bool, read_plot(visit).painted))

    visit.page.on("request", count)
    streams = watch(visit)
    visit.open(f"{QUICK}?live=10s")
    visit.wait_for_chart(mode="live")
    visit.wait_for_answers()
    asked.clear()
    before, least = painted(), math.inf
    for _ in range(8):
        for _ in range(5):
            lag(streams[0])
            visit.page.wait_for_timeout(40)
        least = min(least, painted())
    wait_until(lambda: bool(visit.evaluate("1") and asked), "what was left out is asked for")
    assert len(asked) < 8, "of 40 times that something was left out"
    assert least > before / 2
