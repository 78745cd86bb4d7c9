"""Peaks: certain and possible ones, distinguished by shape."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlencode, urlsplit

import pytest

from eskin.wire.timestamp import parse_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import CHART, history

if TYPE_CHECKING:
    from playwright.sync_api import APIResponse, Route

    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.replay import Replay

HALF = 1_300_000_000
"""Half of a window, ns."""
APART = 45_000_000
"""Peaks with more than this between them (ns) are drawn one by one in such a window."""

INSIDE = {"certain": "184 58 0", "possible": "255 255 255"}
"""In which colour a peak's triangle is filled."""
TRIANGLES = """
() => {
  const root = document.querySelector("[data-testid=chart]");
  const canvas = root.querySelector("canvas");
  const pen = canvas.getContext("2d");
  const { plotLeft, plotTop, plotWidth } = root.dataset;
  return [...root.querySelectorAll("[data-testid=peak]")].flatMap((hit) => {
    const [x, y] = hit.style.transform.match(/-?[0-9.]+/g).map(Number);
    if (x < 8 || x > plotWidth - 24) return [];
    const at = [Number(plotLeft) + x + 8, Number(plotTop) + y + 12 - 5];
    const inside = [...pen.getImageData(Math.round(at[0]), Math.round(at[1]), 1, 1).data];
    return [{ verdict: hit.dataset.verdict, inside: inside.slice(0, 3).join(" ") }];
  });
}
"""


LISTED = """
() => [...document.querySelectorAll("[data-testid=event]")].map((row) => row.dataset.id)
"""
PAINT = """
(svg) => {
  const style = getComputedStyle(svg.querySelector("path"));
  return { fill: style.fill, dash: style.strokeDasharray };
}
"""


def window_of_both(replay: Replay) -> tuple[int, int]:
    """A stretch of time with a certain and a possible peak, each of them apart from others."""
    place = {"node": "palm", "channel": "t01.energy", "kind": "peak", "limit": 200}
    found: list[int] = []

    def look() -> bool:
        items: list[dict[str, Any]] = replay.get("/events", **place)["items"]
        begins = sorted((parse_timestamp(item["time"]["lo"]), item["verdict"]) for item in items)
        instants = [begin for begin, _ in begins]
        lone = [
            (begin, verdict)
            for begin, verdict in begins
            if sum(abs(begin - other) < APART for other in instants) == 1
        ]
        certain = [begin for begin, verdict in lone if verdict == "certain"]
        for begin, verdict in lone:
            near = any(abs(begin - other) < HALF - APART for other in certain)
            # What lies before the oldest on the page of answers is not known.
            whole = instants[0] + APART < begin < instants[-1] - HALF
            if verdict == "possible" and near and whole:
                found.append(begin)
        return bool(found)

    wait_until(look, "a possible and a certain peak stand apart")
    return found[0] - HALF, found[0] + HALF


def test_certain_and_possible_peaks_carry_different_shapes(replay: Replay, visit: Visit) -> None:
    visit.open(history("palm/t01.energy", *window_of_both(replay)))
    visit.wait_for_chart(mode="history")
    peak = visit.page.get_by_test_id("peak")
    peak.and_(visit.page.locator("[data-verdict=possible]")).first.wait_for()
    peak.and_(visit.page.locator("[data-verdict=certain]")).first.wait_for()
    wait_until(
        lambda: {one["verdict"] for one in visit.evaluate(TRIANGLES)} == {"certain", "possible"},
        "both are placed",
    )
    found = visit.evaluate(TRIANGLES)
    assert {(one["verdict"], one["inside"]) for one in found} == set(INSIDE.items())


@pytest.mark.nightly
@pytest.mark.parametrize("options", [{"viewport": {"width": 700, "height": 800}}])
def test_peak_buttons_follow_their_peaks_on_resize(replay: Replay, visit: Visit) -> None:
    held: list[Route] = []
    # Whatever comes in has the chart painted anew, and all of it put in its place.
    visit.page.route("**/api/v1/live?*", lambda route: held.append(route))  # noqa: PLW0108 -- Playwright marks what it is given
    visit.open(history("palm/t01.energy", *window_of_both(replay)))
    visit.wait_for_chart(mode="history")
    wait_until(lambda: len(visit.evaluate(TRIANGLES)) > 1, "peaks are placed")
    visit.wait_for_answers()
    before = visit.chart()["plotWidth"]
    visit.page.set_viewport_size({"width": 1000, "height": 800})
    wait_until(lambda: visit.chart()["plotWidth"] != before, "the chart has another size")
    found = visit.evaluate(TRIANGLES)
    assert found
    assert [one for one in found if one["inside"] != INSIDE[one["verdict"]]] == []


@pytest.mark.nightly
@pytest.mark.parametrize("options", [{"reduced_motion": "no-preference"}])
def test_peak_buttons_follow_their_peaks_under_the_pointer(visit: Visit) -> None:
    visit.open("palm/t01.energy?live=10s")
    visit.wait_for_chart(mode="live")
    visit.page.locator(CHART).hover(position={"x": 3, "y": 3})
    for _ in range(5):
        wait_until(lambda: len(visit.evaluate(TRIANGLES)) > 1, "peaks are placed")
        found = visit.evaluate(TRIANGLES)
        assert [one for one in found if one["inside"] != INSIDE[one["verdict"]]] == []
        visit.page.wait_for_timeout(130)


@pytest.mark.nightly
def test_listed_events_carry_different_symbols(visit: Visit) -> None:
    visit.open("palm/t01.energy")
    symbols = {}
    for verdict in ("certain", "possible"):
        row = visit.page.locator(f"[data-testid=event][data-verdict={verdict}]").first
        row.wait_for()
        symbols[verdict] = row.locator("svg").first.evaluate(PAINT)
        assert f"{verdict} peak" in (row.text_content() or "")
    assert symbols["certain"]["fill"] != "none"
    assert symbols["certain"]["dash"] == "none"
    assert symbols["possible"]["fill"] == "none"
    assert symbols["possible"]["dash"] != "none"


@pytest.mark.nightly
def test_event_that_arrives_during_loading_stays_listed(visit: Visit) -> None:
    asked: list[tuple[Route, APIResponse]] = []
    visit.page.route(
        "**/api/v1/events?*limit=50&*", lambda route: asked.append((route, route.fetch()))
    )
    visit.open("palm/t01.energy?live=10s")
    wait_until(lambda: bool(visit.evaluate("1") and asked), "the store has answered")
    ((route, answer),) = asked
    stored = {item["id"] for item in answer.json()["items"]}
    assert stored
    stated: set[str] = set()

    def has_event() -> bool:
        stated.update(item["id"] for item in route.fetch().json()["items"])
        return not stated <= stored

    wait_until(has_event, "there is an event that was not stored yet")
    # Blocks that were measured since are stated behind it.
    now = time.time_ns()
    wait_until(lambda: visit.newest() > now, "the stream has stated of it")
    route.fulfill(response=answer)
    wait_until(lambda: stored | stated <= set(visit.evaluate(LISTED)), "the list holds all of them")


@pytest.mark.nightly
def test_page_notes_since_when_peaks_are_marked(visit: Visit) -> None:
    def endless(route: Route) -> None:
        url = urlsplit(route.request.url)
        asked = {name: value for name, value in parse_qsl(url.query) if name != "cursor"}
        answer = route.fetch(url=url._replace(query=urlencode(asked)).geturl())
        latest = answer.json()["items"][:3]
        if asked.get("kind") == "peak" and latest:
            route.fulfill(response=answer, json={"items": latest, "next": "more"})
        else:
            route.fulfill(response=answer)

    visit.page.route("**/api/v1/events?*", endless)
    visit.open("fingertip/t01.capacitance?live=5m")
    note = visit.page.get_by_test_id("events-note")
    note.get_by_text("on are marked in the charts: zoom in for all").wait_for()
    assert note.inner_text().startswith("Only peaks from ")
    # Nothing more is sent from here on, so that it stands until the window begins after it.
    held: list[Route] = []
    visit.page.route("**/api/v1/events?*", lambda route: held.append(route))  # noqa: PLW0108 -- Playwright marks what it is given
    visit.page.get_by_test_id("live-span").select_option(label="5 s")
    note.get_by_text("Only peaks").wait_for(state="detached")
    assert note.text_content() == ""
