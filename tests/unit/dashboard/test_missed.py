"""What comes between two questions, or two streams, is told all the same."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from eskin.wire.timestamp import parse_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import history
from tests.unit.dashboard.pixels import read_plot

if TYPE_CHECKING:
    from playwright.sync_api import Request, Route

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


def test_stream_of_another_window_goes_on_after_the_one_before(visit: Visit) -> None:
    sent: list[str | None] = []

    def remember(request: Request) -> None:
        if "/api/v1/live" in request.url:
            sent.append(request.headers.get("last-event-id"))

    visit.page.on("request", remember)
    visit.open(f"{CHANNEL}?live=10s")
    visit.wait_for_chart(mode="live")
    visit.page.get_by_test_id("live-span").select_option("300000000000")
    wait_until(lambda: bool(visit.evaluate("1") and len(sent) > 1), "there is another stream")
    assert sent[0] is None
    assert sent[1]


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


def lag(route: Route) -> None:
    """Tell that something was left out; then the stream is over for a while."""
    said = 'retry: 60000\n\nid: 9\nevent: lagging\ndata: {"after": "1", "resumed": "9"}\n\n'
    route.fulfill(body=said, content_type="text/event-stream")


def test_events_are_listed_again_where_the_stream_left_some_out(visit: Visit) -> None:
    lists: list[str] = []

    def count(request: Request) -> None:
        if "/api/v1/events?" in request.url and "limit=50&" in f"{request.url}&":
            lists.append(request.url)

    visit.page.on("request", count)
    visit.page.route("**/api/v1/live?*", lag)
    visit.open(f"{CHANNEL}?live=10s")
    # Once as the stream began, and once more.
    wait_until(lambda: bool(visit.evaluate("1") and len(lists) > 1), "they are asked for again")


@pytest.mark.nightly
def test_window_of_the_past_is_asked_for_again_where_the_stream_left_some_out(
    visit: Visit, recorded: int
) -> None:
    asked: list[str] = []
    held: list[Route] = []

    def count(request: Request) -> None:
        if "/api/v1/series/" in request.url:
            asked.append(request.url)

    visit.page.on("request", count)
    visit.page.route("**/api/v1/live?*", lambda route: held.append(route))  # noqa: PLW0108 -- Playwright marks what it is given
    visit.open(history(CHANNEL, recorded - SECOND, recorded))
    visit.wait_for_chart(mode="history")
    before = len(asked)
    lag(held[0])
    wait_until(lambda: bool(visit.evaluate("1") and len(asked) > before), "it is asked for again")
