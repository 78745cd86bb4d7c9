"""The dashboard for those who work it without a mouse, and for those who hear it."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import CHART, history, visiting
from tests.unit.dashboard.record import NODES
from tests.unit.dashboard.spoken import listen, listen_until, nameless

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.replay import Replay
    from tests.unit.dashboard.spoken import Spoken

SECOND = 1_000_000_000
MS = 1_000_000
CHANNEL = "palm/t01.energy"
FOCUS = """
() => {
  const focused = document.activeElement;
  const { outlineStyle, outlineWidth } = getComputedStyle(focused);
  const { testid, node } = focused.dataset;
  const ring = outlineStyle !== "none" && parseFloat(outlineWidth) >= 1;
  return { id: testid ?? focused.tagName, of: node ?? "", ring };
}
"""
"""What has the focus, and whether that can be seen."""
SPOKEN = """
() => document.querySelector("[data-testid=chart] [aria-live=polite]").textContent
"""


@pytest.mark.nightly
def test_everything_in_the_overview_has_a_name(replay: Replay, visit: Visit) -> None:
    (gateway,) = replay.get("/gateways")["items"]
    # The fingertip is shown as a picture.
    plain = [node for node in NODES if node != "fingertip"]
    channels = [one for node in plain for one in replay.get(f"/nodes/{node}/channels")["items"]]

    def are_online(heard: list[Spoken]) -> bool:
        links = [one.name for one in heard if one.role == "link"]
        return all(any(name.startswith(f"{node} online") for name in links) for node in NODES)

    visit.open("")
    visit.wait_for_chart(mode="live")
    visit.page.locator("[data-testid=gateway]").wait_for()
    visit.page.locator("[data-testid=event]").first.wait_for()
    visit.page.locator("[data-node=fingertip] [data-testid=skin-stage]").wait_for()
    # One node after another lists its channels.
    wait_until(lambda: visit.page.locator(CHART).count() == len(channels), "all charts are there")
    heard = listen_until(visit, are_online, "the card of each node says that it is online")
    assert nameless(heard) == {}
    named = {(one.role, one.name) for one in heard}
    assert {("button", "log out"), ("button", "Zoom in"), ("main", "All nodes")} <= named
    assert ("region", f"gateway {gateway['id']}") in named
    charts = [one.name for one in heard if one.name.startswith("Chart of ")]
    assert len(charts) == len(channels) == len(set(charts))
    # An outbox with room is shown on its node's page alone.
    visit.open("palm")
    visit.page.locator("[data-testid=node][data-node=palm] [role=meter]").wait_for()
    assert [one.role for one in listen(visit)].count("meter") == 1


def test_everything_on_a_node_has_a_name(visit: Visit) -> None:
    visit.open("fingertip")
    visit.wait_for_chart(mode="live")
    row = visit.page.get_by_test_id("channel-row").first
    wait_until(lambda: any(map(str.isdigit, row.inner_text()[3:])), "values are listed")
    heard = listen(visit)
    assert nameless(heard) == {}
    assert any(one.role == "application" and "fingertip" in one.name for one in heard)
    links = [one.name for one in heard if one.role == "link"]
    for taxel in ("t01", "t02", "t03"):
        assert any(name.startswith(f"{taxel}.capacitance") for name in links)


def test_everything_on_a_channel_has_a_name(visit: Visit) -> None:
    visit.open(f"{CHANNEL}?live=10s&above=5e-12")
    visit.wait_for_chart(mode="live")
    visit.page.get_by_test_id("total-certain").wait_for()
    visit.page.locator("[data-testid=compare] summary").click()
    visit.page.get_by_test_id("model-ask").wait_for()

    def peaks_of(heard: list[Spoken]) -> list[str]:
        return [one.name for one in heard if one.role == "button" and "peak" in one.name]

    heard = listen_until(visit, lambda heard: bool(peaks_of(heard)), "a live window has peaks")
    assert nameless(heard) == {}
    named = {(one.role, one.name) for one in heard}
    assert {("main", "palm t01.energy"), ("textbox", "threshold"), ("button", "Ask")} <= named
    peaks = peaks_of(heard)
    assert all("height" in name or "peaks, " in name for name in peaks)


@pytest.mark.nightly
def test_everything_on_the_login_has_a_name(demo: RunningDemo, browser: Browser) -> None:
    with visiting(browser, demo.access["url"]) as visit:
        visit.page.goto(f"{demo.access['url']}/login")
        visit.page.locator("input").wait_for()
        heard = listen(visit)
    assert nameless(heard) == {}
    named = {(one.role, one.name) for one in heard}
    assert {("textbox", "Access token"), ("button", "Sign in")} <= named


def tabs(visit: Visit, most: int) -> list[dict[str, str | bool]]:
    """Where so many strokes of the tabulator lead to, from the beginning of the page."""
    visit.evaluate("() => document.activeElement.blur()")
    found = []
    for _ in range(most):
        visit.page.keyboard.press("Tab")
        found.append(visit.evaluate(FOCUS))
    return found


def test_tabulator_reaches_the_skin_and_then_the_charts(visit: Visit, recorded: int) -> None:
    visit.open(history("fingertip", recorded - 2 * SECOND, recorded))
    visit.wait_for_chart(mode="history")
    visit.wait_for_answers()
    stops = tabs(visit, 40)
    order = [stop["id"] for stop in stops]
    assert order.count("chart") >= 3
    wanted = ("go-live", "logout", "node", "skin-stage", "skin-level", "channel-link", "chart")
    assert [order.index(name) for name in wanted] == sorted(order.index(name) for name in wanted)
    assert [stop for stop in stops if stop["id"] != "BODY" and not stop["ring"]] == []


@pytest.mark.nightly
def test_tabulator_reaches_the_peaks_of_a_chart_and_the_questions_after_it(
    visit: Visit, recorded: int
) -> None:
    visit.open(history(CHANNEL, recorded - 3 * SECOND, recorded))
    visit.wait_for_chart(mode="history")
    visit.page.get_by_test_id("peak").first.wait_for()
    visit.page.get_by_test_id("threshold-side").wait_for()
    visit.wait_for_answers()
    count = visit.page.get_by_test_id("peak").count()
    stops = tabs(visit, 30 + count)
    order = [stop["id"] for stop in stops]
    chart = order.index("chart")
    assert order[chart + 1 : chart + 1 + count] == ["peak"] * count
    assert order[chart + 1 + count] == "threshold-side"
    assert [stop for stop in stops if stop["id"] != "BODY" and not stop["ring"]] == []


def test_channel_and_peak_open_by_key_and_keep_the_focus_on_the_page(
    visit: Visit, recorded: int
) -> None:
    visit.open(history("fingertip", recorded - 2 * SECOND, recorded))
    visit.wait_for_chart(mode="history")
    row = visit.page.locator("[data-testid=channel-row][data-channel='t02.capacitance']")
    row.focus()
    visit.page.keyboard.press("Enter")
    wait_until(lambda: "#/fingertip/t02." in visit.evaluate("location.hash"), "the channel opens")
    # A link changes the address before the page takes it over.
    wait_until(lambda: visit.evaluate(FOCUS)["id"] == "MAIN", "the focus is on the page")
    visit.open(history(CHANNEL, recorded - 3 * SECOND, recorded))
    visit.wait_for_chart(mode="history", node="palm")
    peak = visit.page.get_by_test_id("peak").first
    peak.focus()
    assert " peak" in (peak.get_attribute("aria-label") or "")
    assert visit.page.get_by_test_id("tooltip").is_visible()
    before = visit.evaluate("location.hash")
    visit.page.keyboard.press("Enter")
    wait_until(lambda: visit.evaluate("location.hash") != before, "the peak is shown from near")


@pytest.mark.nightly
def test_enter_opens_the_channel_of_a_chart(visit: Visit, recorded: int) -> None:
    window = history("palm", recorded - 2 * SECOND, recorded)
    visit.open(window)
    chart = visit.page.locator(f"{CHART}[data-channel='t01.energy']")
    chart.focus()
    visit.page.keyboard.press("Enter")
    opened = window.replace("palm", CHANNEL).removeprefix(CHANNEL)
    wait_until(
        lambda: f"#/{CHANNEL}{opened}" == visit.evaluate("decodeURIComponent(location.hash)"),
        "the channel is open, with the same window",
    )
    assert visit.evaluate(FOCUS)["id"] == "MAIN"
    visit.page.keyboard.press("Tab")
    assert visit.evaluate("() => document.querySelector('main').contains(document.activeElement)")


@pytest.mark.nightly
def test_shift_and_arrows_move_by_half_a_window(visit: Visit, recorded: int) -> None:
    start, end = recorded - 2 * SECOND, recorded
    visit.open(history(CHANNEL, start, end))
    visit.wait_for_chart(mode="history")
    visit.page.locator(CHART).focus()
    for key, by in (("ArrowLeft", -SECOND), ("ArrowLeft", -2 * SECOND), ("ArrowRight", -SECOND)):
        visit.page.keyboard.press(f"Shift+{key}")
        wait_until(
            lambda: int(visit.chart()["xMin"]) == pytest.approx(start + by, abs=20),  # noqa: B023 -- waited for at once
            f"Shift and {key} move the window",
        )
    assert int(visit.chart()["xMax"]) == pytest.approx(end - SECOND, abs=20)


@pytest.mark.nightly
@pytest.mark.parametrize("key", ["l", "L"])
def test_chart_goes_live_by_small_and_capital_letter(visit: Visit, recorded: int, key: str) -> None:
    visit.open(history(CHANNEL, recorded - SECOND, recorded))
    visit.wait_for_chart(mode="history")
    visit.page.locator(CHART).focus()
    visit.page.keyboard.press(key)
    visit.wait_for_chart(mode="live")


@pytest.mark.nightly
def test_letter_alone_does_nothing_outside_of_a_chart(visit: Visit, recorded: int) -> None:
    start, end = recorded - SECOND, recorded
    visit.open(history(CHANNEL, start, end))
    visit.wait_for_chart(mode="history")
    visit.page.keyboard.press("l")
    visit.page.locator(CHART).focus()
    visit.page.keyboard.press("ArrowLeft")
    # From a live window the next key would have led to another one.
    moved = pytest.approx((start - 100 * MS, end - 100 * MS), rel=0, abs=20)
    assert visit.wait_for_window((start, end)) == moved


@pytest.mark.nightly
def test_escape_takes_the_box_away_that_covers_the_picture(visit: Visit) -> None:
    visit.open(f"{CHANNEL}?live=10s")
    visit.wait_for_chart(mode="live")
    box, plot = visit.page.get_by_test_id("tooltip"), visit.page.locator(".u-over")
    size = plot.bounding_box()
    assert size is not None
    # Down there no peak comes by, which would have a box of its own.
    plot.hover(position={"x": size["width"] / 2, "y": size["height"] - 3})
    box.wait_for()
    visit.page.keyboard.press("Escape")
    box.wait_for(state="hidden")
    newest = visit.newest()
    wait_until(lambda: visit.newest() != newest, "the picture goes on")
    assert box.is_hidden()
    plot.hover(position={"x": size["width"] / 3, "y": size["height"] - 3})
    box.wait_for()


@pytest.mark.nightly
def test_comma_and_full_stop_step_through_samples_and_read_them_out(
    replay: Replay, visit: Visit, recorded: int
) -> None:
    visit.open(history(CHANNEL, recorded - 60 * MS, recorded))
    facts = visit.wait_for_chart(mode="history", resolution="sample")
    visit.page.locator(CHART).focus()
    assert visit.evaluate(SPOKEN) == ""

    def press(key: str) -> str:
        before = visit.evaluate(SPOKEN)
        visit.page.keyboard.press(key)
        wait_until(lambda: visit.evaluate(SPOKEN) != before, f"{key} is answered")
        return str(visit.evaluate(SPOKEN))

    later = [press(".") for _ in range(4)]
    assert all(", sample, at " in text and "coverage " in text for text in later)
    clocks = [text.split(", at ")[1].split(",")[0] for text in later]
    assert clocks == sorted(set(clocks))
    assert [press(",") for _ in range(3)] == later[-2::-1]
    series = replay.get(f"/series/{CHANNEL}", start=facts["xMin"], end=facts["xMax"], points=20_000)
    step = 1e-9 * series["dt"]
    seconds = [float(clock.rsplit(":", 1)[1]) for clock in clocks]
    apart = {round((two - one) % 60 / step) for one, two in pairwise(seconds)}
    assert apart == {1}, "each step is a sample"
