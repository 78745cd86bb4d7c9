"""Gestures on the picture of a skin, live and in the past."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import parse_qs, urlsplit

import pytest

from eskin.wire.timestamp import format_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import PHONE, history
from tests.unit.dashboard.conftest import watched
from tests.unit.dashboard.skin_cloud import LOOP_NS, SkinCloud
from tests.unit.dashboard.spoken import listen, nameless

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from playwright.sync_api import Browser, Locator, Route

    from tests.unit.dashboard.browsing import Visit

VIEW: Final = "[data-testid=skin-view]"
SECOND: Final = 10**9
MOVING: Final = {"reduced_motion": "no-preference"}
DASHES: Final = """
() => [...document.querySelectorAll(".skin-ways path:not(.under)")].map(
  (line) => [line.getAttribute("class"), getComputedStyle(line).strokeDasharray])
"""


@pytest.fixture(scope="module")
def skins() -> Iterator[SkinCloud]:
    """A cloud with two skins."""
    with SkinCloud() as running:
        yield running


@pytest.fixture
def visit(skins: SkinCloud, browser: Browser, options: dict[str, Any]) -> Iterator[Visit]:
    """A page of it."""
    yield from watched(browser, skins.url, options)


def gesture(kind: str, verdict: str, begin: int, end: int, **more: Any) -> dict[str, Any]:
    """A gesture of the glove's middle, from left to right."""
    return {
        "kind": kind,
        "verdict": verdict,
        "contacts": [0],
        "begin": {"lo": format_timestamp(begin), "hi": format_timestamp(begin + 1000)},
        "end": {"lo": format_timestamp(end - 1000), "hi": format_timestamp(end)},
        "direction": None,
        "angle": None,
        "scale": None,
        "places": [
            {"begin": [[0.03, 0.032], [0.05, 0.052]], "end": [[0.07, 0.072], [0.05, 0.052]]}
        ],
        **more,
    }


def swipe(begin: int, end: int) -> dict[str, Any]:
    return gesture("swipe", "certain", begin, end, direction={"lo": -0.05, "hi": 0.05})


class Answers:
    """What the cloud says of gestures, and the windows that it was asked for."""

    def __init__(
        self, visit: Visit, found: Callable[[int, int], list[dict[str, Any]]], *, status: int = 200
    ) -> None:
        self.windows: list[tuple[int, int]] = []
        self._found, self._status = found, status
        visit.page.route("**/api/v1/nodes/*/gestures*", self._answer)

    def _answer(self, route: Route) -> None:
        query = parse_qs(urlsplit(route.request.url).query)
        start, end = int(query["start"][0]), int(query["end"][0])
        self.windows.append((start, end))
        body = {"items": self._found(start, end), "next": None}
        route.fulfill(status=self._status, body=json.dumps(body), content_type="application/json")


def labels(visit: Visit) -> Locator:
    return visit.page.get_by_test_id("gesture-label")


def rows(visit: Visit) -> list[str]:
    return visit.page.get_by_test_id("gesture").all_inner_texts()


@pytest.mark.parametrize("options", [MOVING, MOVING | PHONE])
def test_live_gestures_are_drawn_and_listed(visit: Visit) -> None:
    def found(start: int, end: int) -> list[dict[str, Any]]:
        above = [[0.03, 0.032], [0.1, 0.102]]
        tap = gesture(
            "tap", "possible", start + SECOND, start + 2 * SECOND,
            contacts=[1], places=[{"begin": above, "end": above}],
        )  # fmt: skip
        return [tap, swipe(end - SECOND // 2, end - SECOND // 5)]

    answers = Answers(visit, found)
    visit.open("glove", shows=VIEW)
    labels(visit).nth(1).wait_for()
    texts = labels(visit).all_inner_texts()
    assert {"swipe →", "possible tap"} <= set(texts)
    drawn = dict(visit.evaluate(DASHES))
    assert drawn.keys() == {"certain", "possible"}
    assert drawn["certain"] == "none" != drawn["possible"]
    for kind, verdict in (("swipe →", "certain"), ("tap", "possible")):
        listed = visit.page.get_by_test_id("gesture").filter(has_text=kind).first
        listed.wait_for()
        assert listed.get_attribute("data-verdict") == verdict
        assert verdict in listed.inner_text()
    assert nameless(listen(visit)) == {}
    # Short windows, one a second at most.
    before = visit.asked("/gestures?")
    wait_until(lambda: visit.asked("/gestures?") >= before + 3, "it asks again")
    ends = [end for _, end in answers.windows]
    assert all(end - start == 3 * SECOND for start, end in answers.windows)
    assert ends[-1] - ends[0] >= 0.9 * SECOND * (len(ends) - 1) - SECOND


@pytest.mark.parametrize("options", [MOVING])
def test_name_of_what_is_possible_hides_none_of_what_is_certain(visit: Visit) -> None:
    def found(_: int, end: int) -> list[dict[str, Any]]:
        begin, over = end - SECOND // 2, end - SECOND // 5
        tap = gesture("tap", "possible", begin, over, contacts=[])
        return [tap, swipe(begin, over), gesture("slide", "possible", begin, over, contacts=[1])]

    Answers(visit, found)
    visit.open("glove", shows=VIEW)
    labels(visit).nth(2).wait_for(state="attached")
    assert labels(visit).filter(visible=True).all_inner_texts() == ["swipe →"]


@pytest.mark.nightly
@pytest.mark.parametrize("options", [MOVING])
def test_arrow_goes_from_begin_to_end_on_the_skin(visit: Visit) -> None:
    Answers(visit, lambda _, end: [swipe(end - SECOND // 2, end - SECOND // 5)])
    visit.open("glove", shows=VIEW)
    labels(visit).first.wait_for()
    line = visit.page.locator(".skin-ways .certain").first
    x = [line.evaluate(f"(path) => path.getPointAtLength({part}).x") for part in (0, 20)]
    assert x[0] < x[1]
    plate, label = (
        visit.page.locator(where).first.bounding_box()
        for where in (".skin-plate", "[data-testid=gesture-label]")
    )
    assert plate is not None
    assert label is not None
    assert plate["x"] <= label["x"]
    assert label["x"] + label["width"] <= plate["x"] + plate["width"] + 1


@pytest.mark.nightly
def test_window_of_the_past_is_asked_once_and_shown_at_its_instant(
    skins: SkinCloud, visit: Visit
) -> None:
    end = skins.end // LOOP_NS * LOOP_NS - LOOP_NS
    answers = Answers(visit, lambda *_: [swipe(end - 3 * SECOND, end - 2 * SECOND)])
    visit.open(history("glove", end - 6 * SECOND, end), shows=VIEW)
    visit.page.get_by_test_id("gesture").wait_for()
    assert labels(visit).count() == 0  # the film stands at the end of the window
    strip = visit.page.get_by_test_id("film-strip")
    box = strip.bounding_box()
    assert box is not None
    strip.click(position={"x": box["width"] * 0.6, "y": box["height"] / 2})
    labels(visit).first.wait_for()
    assert labels(visit).all_inner_texts() == ["swipe →"]
    strip.click(position={"x": box["width"] * 0.1, "y": box["height"] / 2})
    labels(visit).first.wait_for(state="detached")
    assert rows(visit) == []
    assert answers.windows == [(end - 7 * SECOND, end + SECOND)]


@pytest.mark.nightly
def test_skin_of_which_the_cloud_finds_no_gestures_is_not_asked_again(visit: Visit) -> None:
    answers = Answers(visit, lambda *_: [], status=422)
    visit.open("glove", shows=VIEW)
    wait_until(lambda: visit.asked("/gestures?") == 1, "it is asked")
    visit.page.wait_for_timeout(2500)
    assert len(answers.windows) == 1
    assert visit.page.locator(".skin-gestures").is_hidden()
    assert all("422" in trouble for trouble in visit.troubles)
    visit.troubles.clear()


@pytest.mark.nightly
def test_overview_asks_for_no_gestures(visit: Visit) -> None:
    answers = Answers(visit, lambda *_: [])
    visit.open("", shows=VIEW)
    wait_until(lambda: visit.asked("/api/v1/nodes") > 1, "the page is there")
    visit.page.wait_for_timeout(1500)
    assert answers.windows == []
