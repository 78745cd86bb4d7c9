"""What the page says while there is nothing, not yet something, or no way to get it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from eskin.wire.timestamp import parse_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import CHART, history

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Route

    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.replay import Replay

SECOND = 1_000_000_000
CHANNEL = "palm/t01.energy"
SERIES = f"**/api/v1/series/{CHANNEL}*"
SAID = "The store is away: Come back in an instant."
ROOMY = {"viewport": {"width": 1280, "height": 2400}}
"""All charts of a node are in sight."""
SOON_MS = 500
"""Sooner than the page tries again by itself (5 s)."""
ASKED_SOON = """
(soon) => {
  const { fetch } = window;
  const asked = [];
  const note = (done) => {
    window.fetch = (address, ...rest) => {
      asked.push(address);
      return fetch(address, ...rest);
    };
    setTimeout(() => done(asked), soon);
  };
  window.askedSoon = new Promise((done) =>
    addEventListener("click", () => note(done), { capture: true, once: true }));
}
"""
"""Notes what the page asks for soon after the next click, by its own timers, which keep their order
however slow it is."""


def notice(kind: str, within: str = "") -> str:
    return f"{within} [data-testid=notice-{kind}]"


def panel(channel: str) -> str:
    return f"[data-testid=channel][data-channel='{channel}']"


def refuse(route: Route) -> None:
    problem = {"title": "The store is away", "status": 503, "detail": "Come back in an instant."}
    route.fulfill(status=503, json=problem)


def undescribe(route: Route) -> None:
    """As of nodes that have sent no layout yet."""
    answer = route.fetch()
    items = [{**item, "layout": None} for item in answer.json()["items"]]
    route.fulfill(response=answer, json={"items": items, "next": None})


def refused(visit: Visit) -> None:
    """The browser itself complains of each refusal."""
    assert all("503" in trouble for trouble in visit.troubles)
    visit.troubles.clear()


def try_again(visit: Visit, error: Locator, asks: str) -> None:
    """Press the button, which asks at once, while it is still refused."""
    visit.evaluate(ASKED_SOON, SOON_MS)
    error.get_by_role("button", name="Try again").click()
    assert [each for each in visit.evaluate("askedSoon") if asks in each]


def wait_for_more(visit: Visit, channel: str) -> None:
    """Wait until a live chart has moved by two seconds."""
    chart = visit.page.locator(f"[data-testid=chart][data-channel='{channel}']")

    def end() -> int:
        return int(chart.get_attribute("data-newest") or 0)

    wait_until(lambda: end() > 0, f"{channel} is shown")
    begin = end()
    wait_until(lambda: end() > begin + 2 * SECOND, f"{channel} goes on")


@pytest.mark.nightly
def test_without_nodes_the_page_says_so_until_one_comes(visit: Visit) -> None:
    visit.page.route(
        "**/api/v1/nodes", lambda route: route.fulfill(json={"items": [], "next": None})
    )
    visit.open("", shows=notice("empty", ".column >"))
    said = visit.page.locator(notice("empty", ".column >"))
    assert "No node has reported yet" in said.inner_text()
    assert "eskin node --config" in said.inner_text()
    visit.page.unroute("**/api/v1/nodes")
    visit.page.locator(CHART).first.wait_for()
    assert said.count() == 0


@pytest.mark.nightly
def test_nodes_that_cannot_be_loaded_are_asked_for_again_without_a_word_more(visit: Visit) -> None:
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    visit.page.route("**/api/v1/nodes", refuse)
    visit.open("", shows=notice("error", ".column >"))
    error = visit.page.locator(notice("error", ".column >"))
    assert "The nodes could not be loaded" in error.inner_text()
    assert SAID in error.inner_text()
    button = error.get_by_role("button", name="Try again")
    button.focus()
    before = visit.asked("/api/v1/nodes")
    wait_until(lambda: visit.asked("/api/v1/nodes") > before + 1, "it tries again")
    assert button.evaluate("(button) => button === document.activeElement")
    # What is refused or loaded from here on would take the button away.
    visit.page.route("**/api/v1/nodes", hold)
    wait_until(lambda: bool(visit.evaluate("1") and held), "nothing is answered any more")
    button.press("Enter")
    visit.page.locator(notice("loading", ".column >")).wait_for()
    visit.page.unroute("**/api/v1/nodes")
    visit.page.locator(CHART).first.wait_for()
    assert error.count() == 0
    refused(visit)


@pytest.mark.nightly
def test_page_of_a_node_says_when_the_nodes_cannot_be_loaded(visit: Visit) -> None:
    visit.page.route("**/api/v1/nodes", refuse)
    visit.open(f"{CHANNEL}?live=10s")
    banner = visit.page.get_by_test_id("banner")
    banner.wait_for()
    assert banner.inner_text().startswith(f"{SAID} What is shown may be out of date")
    visit.page.unroute("**/api/v1/nodes")
    banner.wait_for(state="hidden")
    refused(visit)


@pytest.mark.nightly
def test_channels_that_cannot_be_loaded_can_be_asked_for_again(visit: Visit) -> None:
    visit.page.route("**/api/v1/nodes/palm/channels*", refuse)
    visit.open("palm?live=10s", shows=notice("error", ".grid >"))
    error = visit.page.locator(notice("error", ".grid >"))
    assert "The channels of palm could not be loaded" in error.inner_text()
    assert SAID in error.inner_text()
    try_again(visit, error, "/api/v1/nodes/palm/channels")
    visit.page.unroute("**/api/v1/nodes/palm/channels*")
    visit.wait_for_chart(mode="live")
    assert error.count() == 0
    refused(visit)


@pytest.mark.nightly
def test_node_without_channels_and_unknown_channel_are_said(visit: Visit) -> None:
    visit.page.route("**/api/v1/nodes", undescribe)
    visit.open("palm/t01.taste?live=10s", shows=notice("empty", ".grid >"))
    said = visit.page.locator(notice("empty", ".grid >"))
    assert 'palm has no channel "t01.taste"' in said.inner_text()
    visit.open("palm?live=10s", shows=notice("empty", ".grid >"))
    said.get_by_text("palm has no channels yet").wait_for()


def test_page_of_no_node_says_so_and_loads_nothing(visit: Visit) -> None:
    problem = {"title": "Unknown", "status": 404, "detail": "There is no such node."}
    visit.page.route(
        "**/api/v1/nodes/nosuch/*", lambda route: route.fulfill(status=404, json=problem)
    )
    visit.open("nosuch?live=10s", shows=notice("error", ".grid >"))
    visit.page.locator(notice("empty", ".side")).wait_for()
    assert visit.page.locator(notice("loading")).count() == 0
    assert visit.page.get_by_test_id("channel-browser").is_hidden()
    assert all("404" in trouble for trouble in visit.troubles)
    visit.troubles.clear()  # the browser itself complains of each refusal


@pytest.mark.nightly
def test_history_that_cannot_be_loaded_can_be_asked_for_again(visit: Visit, recorded: int) -> None:
    visit.page.route(SERIES, refuse)
    visit.open(history(CHANNEL, recorded - SECOND, recorded), shows=notice("error", ".panel"))
    error = visit.page.locator(notice("error", ".panel"))
    assert "This channel could not be loaded" in error.inner_text()
    assert SAID in error.inner_text()
    try_again(visit, error, f"/api/v1/series/{CHANNEL}")
    visit.page.unroute(SERIES)
    wait_until(lambda: int(visit.chart().get("entries", 0)) > 0, "it is there")
    error.wait_for(state="detached")
    refused(visit)


@pytest.mark.nightly
@pytest.mark.parametrize("options", [ROOMY])
def test_live_channel_that_cannot_be_loaded_says_so_until_it_is_there(visit: Visit) -> None:
    visit.page.route(SERIES, refuse)
    mine = panel("t01.energy")
    visit.open("palm?live=10s", shows=notice("error", mine))
    wait_for_more(visit, "t01.area")
    wait_for_more(visit, "t01.energy")
    error = visit.page.locator(notice("error", mine))
    assert SAID in error.inner_text()
    visit.page.unroute(SERIES)
    error.wait_for(state="detached")
    refused(visit)


@pytest.mark.nightly
def test_history_that_is_not_there_yet_is_loading(visit: Visit, recorded: int) -> None:
    held: list[Route] = []

    def hold(route: Route) -> None:
        # It says how far its times may be wrong; then the page asks around the window.
        if held:
            route.continue_()
        else:
            held.append(route)

    visit.page.route(SERIES, hold)
    visit.open(history(CHANNEL, recorded - SECOND, recorded), shows=notice("loading", ".panel"))
    wait_until(lambda: bool(visit.evaluate("1") and held), "it is asked for")
    assert visit.page.locator(".panel.busy").count() == 1
    held[0].continue_()
    visit.page.locator(notice("loading", ".panel")).wait_for(state="detached")
    assert int(visit.wait_for_chart(mode="history")["entries"]) > 0


def test_pictures_that_are_not_there_yet_are_loading_and_not_unknown(
    visit: Visit, recorded: int
) -> None:
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    visit.page.route("**/api/v1/nodes/fingertip/frames?*", hold)
    loading = notice("loading", "[data-testid=skin-view]")
    visit.open(history("fingertip", recorded - SECOND, recorded), shows=loading)
    said = [visit.page.get_by_test_id(part) for part in ("skin-total", "skin-summary")]
    wait_until(lambda: all(part.inner_text() for part in said), "it says how the skin is")
    assert not any("known" in part.inner_text() for part in said)
    visit.page.unroute("**/api/v1/nodes/fingertip/frames?*")  # lets them go on
    visit.page.locator(loading).wait_for(state="detached")
    wait_until(lambda: any(map(str.isdigit, said[0].inner_text())), "its values are there")


@pytest.mark.nightly
@pytest.mark.parametrize("options", [ROOMY])
def test_live_channel_that_is_not_there_yet_is_loading(visit: Visit) -> None:
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    visit.page.route(SERIES, hold)
    mine = notice("loading", panel("t01.energy"))
    visit.open("palm?live=10s", shows=mine)
    wait_for_more(visit, "t01.area")
    assert visit.page.locator(mine).is_visible()
    visit.page.unroute(SERIES)  # lets them go on
    visit.page.locator(mine).wait_for(state="detached")


@pytest.mark.nightly
@pytest.mark.parametrize("options", [ROOMY])
def test_channel_without_data_says_so_beside_others_that_have_some(visit: Visit) -> None:
    nothing = {"first": None, "last": None, "blocks": 0, "samples": 0, "bytes": 0, "bounds": None}

    def add(route: Route) -> None:
        answer = route.fetch()
        items: list[dict[str, Any]] = answer.json()["items"]
        new = {**items[0], **nothing, "id": "t09.energy", "taxel": "t09"}
        route.fulfill(response=answer, json={"items": [*items, new], "next": None})

    def describe(route: Route) -> None:
        answer = route.fetch()
        layout = answer.json()
        new = {**layout["patches"][0], "patch": "new", "quantity": "energy", "taxels": ["t09"]}
        route.fulfill(response=answer, json={**layout, "patches": [*layout["patches"], new]})

    visit.page.route("**/api/v1/nodes/palm/channels*", add)
    visit.page.route("**/api/v1/nodes/palm/layouts/*", describe)
    mine = panel("t09.energy")
    visit.open("palm?live=10s", shows=mine)
    said = visit.page.locator(notice("empty", mine))
    said.get_by_text("No data yet").wait_for()
    wait_for_more(visit, "t01.area")
    assert "t09.energy" in said.inner_text()


@pytest.mark.nightly
def test_events_that_cannot_be_loaded_are_said_whatever_comes_in(visit: Visit) -> None:
    visit.page.route("**/api/v1/events*", refuse)
    visit.open("palm?live=10s", shows=notice("error", ".side"))
    visit.page.get_by_test_id("events").locator("li").first.wait_for()
    error = visit.page.locator(notice("error", ".side"))
    assert "Events could not be loaded" in error.inner_text()
    assert SAID in error.inner_text()
    try_again(visit, error, "/api/v1/events")
    visit.page.unroute("**/api/v1/events*")
    error.wait_for(state="detached")
    refused(visit)


def test_window_without_samples_leads_to_all_data(
    replay: Replay, visit: Visit, recorded: int
) -> None:
    hour = 3600 * SECOND
    window = history(CHANNEL, recorded - 2 * hour, recorded - hour)
    visit.open(window, shows=notice("empty", ".panel"))
    said = visit.page.locator(notice("empty", ".panel"))
    assert "No samples in this window" in said.inner_text()
    before = visit.window()
    said.get_by_role("button", name="Show all data").click()
    start, end = visit.wait_for_window(before)
    (channel,) = (c for c in replay.get("/nodes/palm/channels")["items"] if c["id"] in CHANNEL)
    assert start == parse_timestamp(channel["first"])
    assert end >= recorded
    assert int(visit.wait_for_chart(mode="history")["entries"]) > 0
    assert said.count() == 0


@pytest.mark.nightly
def test_no_network_is_said_until_it_is_back(visit: Visit) -> None:
    visit.open(f"{CHANNEL}?live=10s")
    visit.page.get_by_test_id("live-status").get_by_text("Receiving").wait_for()
    banner = visit.page.get_by_test_id("banner")
    banner.wait_for(state="hidden")
    visit.page.context.set_offline(offline=True)
    visit.page.get_by_text("No network: check the connection").wait_for()
    banner.get_by_text("What is shown may be out of date").wait_for()
    assert banner.inner_text().startswith("The cloud cannot be reached.")
    visit.page.context.set_offline(offline=False)
    visit.page.get_by_test_id("live-status").get_by_text("Receiving").wait_for()
    banner.wait_for(state="hidden")
    wait_for_more(visit, "t01.energy")
    visit.troubles.clear()  # the browser itself complains of each request without a network


@pytest.mark.nightly
@pytest.mark.usefixtures("live_recorded")
def test_silence_of_a_node_is_said_until_it_speaks(demo: RunningDemo, live_visit: Visit) -> None:
    live_visit.open("forearm/t01.distance?live=10s")
    live_visit.wait_for_chart(mode="live")
    stale = live_visit.page.locator(notice("stale", ".panel"))
    stale.wait_for(state="detached")
    node = demo.children()["forearm"]
    node.suspend()
    try:
        stale.get_by_text("No data after ").wait_for()
    finally:
        node.resume()
    stale.wait_for(state="detached")
