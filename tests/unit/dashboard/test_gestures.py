"""Zoom and pan by wheel, mouse, fingers and the buttons of the time bar."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest

from eskin.wire.timestamp import parse_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import PHONE, history, without_events

if TYPE_CHECKING:
    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.replay import Replay

SECOND = 1_000_000_000
CHANNEL = "palm/t01.energy"
ROUNDING = 10
"""Windows are rounded outward to whole ns; a few gestures in a row add some."""


@dataclass(frozen=True)
class Plot:
    """The plot area of the first chart on the page, in CSS pixels."""

    left: float
    width: float
    middle: float

    def at(self, share: float) -> tuple[float, float]:
        """A whole pixel near to a share of the width: where the pointer goes."""
        return round(self.left + share * self.width), round(self.middle)

    def share(self, share: float) -> float:
        """The share of the width at which that pixel is."""
        return (self.at(share)[0] - self.left) / self.width


def plot_of(visit: Visit) -> Plot:
    visit.wait_for_answers()
    area = visit.page.locator(".u-over").first
    area.scroll_into_view_if_needed()
    box = area.bounding_box()
    assert box is not None
    return Plot(box["x"], box["width"], box["y"] + box["height"] / 2)


def opened(visit: Visit, recorded: int, place: str = CHANNEL) -> tuple[int, int]:
    """Opens the last two seconds of what is recorded, and gives this window."""
    visit.page.route("**/api/v1/events*", without_events)
    start, end = recorded - 2 * SECOND, recorded
    visit.open(history(place, start, end))
    assert visit.wait_for_window(None) == (start, end)
    return start, end


def length(window: tuple[int, int]) -> int:
    return window[1] - window[0]


def instant(window: tuple[int, int], share: float) -> int:
    """The instant at a share of a window."""
    return window[0] + round(share * length(window))


def cut(window: tuple[int, int], one: float, other: float) -> Any:
    """About the part of a window between two shares."""
    return pytest.approx((instant(window, one), instant(window, other)), rel=0, abs=ROUNDING)


def moved(window: tuple[int, int], shares: float) -> Any:
    """About a window that is later by so many of its lengths, and as long."""
    return cut(window, shares, 1 + shares)


def drag(visit: Visit, start: tuple[float, float], end: tuple[float, float]) -> None:
    mouse = visit.page.mouse
    mouse.move(*start)
    mouse.down()
    mouse.move(*end, steps=4)
    mouse.up()


@pytest.mark.nightly
def test_wheel_zooms_about_the_instant_under_the_pointer(visit: Visit, recorded: int) -> None:
    wide = opened(visit, recorded)
    plot = plot_of(visit)
    visit.page.mouse.move(*plot.at(0.25))
    visit.page.mouse.wheel(0, -400)
    near = visit.wait_for_window(wide)
    assert length(near) == pytest.approx(math.exp(-0.6) * length(wide), rel=1e-6)
    held = plot.share(0.25)
    assert instant(near, held) == pytest.approx(instant(wide, held), rel=0, abs=ROUNDING)
    visit.page.mouse.wheel(0, 400)
    assert visit.wait_for_window(near) == cut(wide, 0, 1)


@pytest.mark.nightly
def test_wheel_sideways_pans(visit: Visit, recorded: int) -> None:
    before = opened(visit, recorded)
    plot = plot_of(visit)
    visit.page.mouse.move(*plot.at(0.5))
    visit.page.mouse.wheel(120, 0)
    after = visit.wait_for_window(before)
    assert after == moved(before, 120 / round(plot.width))
    visit.page.keyboard.down("Shift")
    visit.page.mouse.wheel(0, -120)
    visit.page.keyboard.up("Shift")
    assert visit.wait_for_window(after) == cut(before, 0, 1)


@pytest.mark.nightly
def test_wheel_over_one_chart_of_many_scrolls_until_it_has_the_focus_or_ctrl(
    visit: Visit, recorded: int
) -> None:
    before = opened(visit, recorded, "palm")
    plot = plot_of(visit)
    begin = visit.evaluate("scrollY")
    visit.page.mouse.move(*plot.at(0.5))
    visit.page.mouse.wheel(0, 60)
    wait_until(lambda: visit.evaluate("scrollY") == begin + 60, "the page scrolls")
    assert visit.window() == before
    plot = plot_of(visit)
    visit.page.mouse.move(*plot.at(0.5))
    visit.page.keyboard.down("Control")
    visit.page.mouse.wheel(0, -100)
    visit.page.keyboard.up("Control")
    near = visit.wait_for_window(before)
    assert length(near) < length(before)
    visit.page.mouse.click(*plot.at(0.5))
    visit.page.mouse.wheel(0, 100)
    assert length(visit.wait_for_window(near)) > length(near)


@pytest.mark.parametrize(("one", "other"), [(0.2, 0.7), (0.7, 0.2)])
def test_drag_selects_what_to_show(visit: Visit, recorded: int, one: float, other: float) -> None:
    before = opened(visit, recorded)
    plot = plot_of(visit)
    drag(visit, plot.at(one), plot.at(other))
    assert visit.wait_for_window(before) == cut(before, plot.share(0.2), plot.share(0.7))
    assert visit.page.locator(".selection:visible").count() == 0


@pytest.mark.nightly
def test_shift_and_drag_pans(visit: Visit, recorded: int) -> None:
    before = opened(visit, recorded)
    plot = plot_of(visit)
    visit.page.keyboard.down("Shift")
    drag(visit, plot.at(0.6), plot.at(0.3))
    visit.page.keyboard.up("Shift")
    shift = (plot.at(0.6)[0] - plot.at(0.3)[0]) / round(plot.width)
    assert visit.wait_for_window(before) == moved(before, shift)


@pytest.mark.nightly
def test_pan_button_makes_a_drag_pan_until_it_is_released(visit: Visit, recorded: int) -> None:
    before = opened(visit, recorded)
    plot = plot_of(visit)
    mode = visit.page.get_by_test_id("pan-mode")
    mode.click()
    assert mode.get_attribute("aria-pressed") == "true"
    drag(visit, plot.at(0.3), plot.at(0.6))
    shift = (plot.at(0.3)[0] - plot.at(0.6)[0]) / round(plot.width)
    after = visit.wait_for_window(before)
    assert after == moved(before, shift)
    mode.click()
    assert mode.get_attribute("aria-pressed") == "false"
    drag(visit, plot.at(0.3), plot.at(0.6))
    assert visit.wait_for_window(after) == cut(after, plot.share(0.3), plot.share(0.6))


@pytest.mark.nightly
def test_live_chart_stands_still_during_a_drag(replay: Replay, visit: Visit) -> None:
    visit.page.route("**/api/v1/events*", without_events)
    visit.open(f"{CHANNEL}?live=10s")
    begin = visit.wait_for_chart(mode="live")["xMax"]
    wait_until(lambda: visit.chart()["xMax"] != begin, "the window moves")
    plot = plot_of(visit)
    mouse = visit.page.mouse
    mouse.move(*plot.at(0.5))
    mouse.down()
    mouse.move(*plot.at(0.9), steps=4)
    facts = visit.chart()
    held = int(facts["xMin"]), int(facts["xMax"])

    def stored() -> int:
        (channel,) = (c for c in replay.get("/nodes/palm/channels")["items"] if c["id"] in CHANNEL)
        return parse_timestamp(channel["last"])

    before = stored()
    wait_until(lambda: stored() > before + 2 * SECOND, "two more seconds are recorded")
    mouse.up()
    selected = visit.wait_for_window(None)
    assert selected == cut(held, plot.share(0.5), plot.share(0.9))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("button", "start", "end"),
    [
        ("earlier", -0.5, 0.5),
        ("later", 0.5, 1.5),
        ("zoom-in", 0.25, 0.75),
        ("zoom-out", -0.5, 1.5),
    ],
)
def test_button_moves_the_window(
    visit: Visit, recorded: int, button: str, start: float, end: float
) -> None:
    before = opened(visit, recorded)
    visit.page.get_by_test_id(button).click()
    assert visit.wait_for_window(before) == cut(before, start, end)


@pytest.mark.nightly
def test_all_shows_everything_and_live_goes_back(
    replay: Replay, visit: Visit, recorded: int
) -> None:
    before = opened(visit, recorded)
    visit.page.get_by_test_id("show-all").click()
    start, end = visit.wait_for_window(before)
    (channel,) = (c for c in replay.get("/nodes/palm/channels")["items"] if c["id"] in CHANNEL)
    assert start == parse_timestamp(channel["first"])
    assert end >= recorded
    visit.page.get_by_test_id("go-live").click()
    visit.wait_for_chart(mode="live")
    assert visit.window() is None


class Fingers:
    """Fingers on a touch screen."""

    def __init__(self, visit: Visit) -> None:
        self.session = visit.page.context.new_cdp_session(visit.page)

    def _tell(self, kind: str, places: list[tuple[float, float]]) -> None:
        points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(places)]
        self.session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def move(self, *ways: tuple[tuple[float, float], tuple[float, float]]) -> None:
        """Put down a finger after another, move all of them from here to there, lift them."""
        for count in range(1, len(ways) + 1):
            self._tell("touchStart", [start for start, _ in ways[:count]])
        for step in range(1, 6):
            self._tell(
                "touchMove",
                [
                    (x0 + (x1 - x0) * step / 5, y0 + (y1 - y0) * step / 5)
                    for (x0, y0), (x1, y1) in ways
                ],
            )
        self._tell("touchEnd", [])


@pytest.mark.parametrize("options", [PHONE])
def test_one_finger_pans(visit: Visit, recorded: int) -> None:
    before = opened(visit, recorded)
    plot = plot_of(visit)
    Fingers(visit).move((plot.at(0.8), plot.at(0.4)))
    after = visit.wait_for_window(before)
    shift = (plot.at(0.8)[0] - plot.at(0.4)[0]) / round(plot.width)
    assert after == moved(before, shift)


@pytest.mark.nightly
@pytest.mark.parametrize("options", [PHONE])
@pytest.mark.parametrize(
    ("before", "after"),
    [((0.4, 0.6), (0.1, 0.8)), ((0.2, 0.9), (0.3, 0.5)), ((0.1, 0.3), (0.6, 0.8))],
)
def test_two_fingers_keep_the_instants_under_them(
    visit: Visit, recorded: int, before: tuple[float, float], after: tuple[float, float]
) -> None:
    wide = opened(visit, recorded)
    plot = plot_of(visit)
    fingers = zip(before, after, strict=True)
    Fingers(visit).move(*((plot.at(start), plot.at(end)) for start, end in fingers))
    near = visit.wait_for_window(wide)
    pixel = max(length(wide), length(near)) / plot.width
    for start, end in zip(before, after, strict=True):
        touched = instant(wide, plot.share(start))
        assert instant(near, plot.share(end)) == pytest.approx(touched, rel=0, abs=pixel)
