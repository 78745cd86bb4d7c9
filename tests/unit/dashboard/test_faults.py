"""When the cloud or the session goes away."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import CHART, visiting
from tests.unit.dashboard.pixels import read_plot

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Response, Route, WebSocket, WebSocketRoute

    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.conftest import Session

STATES = """
() => {
  const status = document.querySelector("[data-testid=live-status]");
  window.states = [];
  const note = () => states.push(status.dataset.state);
  new MutationObserver(note).observe(status, { attributes: true });
}
"""
"""Notes each state of the stream, however short it is."""
CANVAS = f"() => document.querySelector('{CHART} canvas').clientWidth"


@pytest.mark.nightly
def test_session_that_ends_leads_to_the_login(
    demo: RunningDemo, browser: Browser, session: Session
) -> None:
    left: list[Route] = []
    refused: list[str] = []

    def hold(route: Route) -> None:
        left.append(route)

    def note(answer: Response) -> None:
        if answer.status == 401:
            refused.append(answer.url)

    def refusals() -> int:
        # Takes in what the browser stated meanwhile; a page that is leaving evaluates nothing.
        visit.page.wait_for_timeout(20)
        return len(refused)

    with visiting(browser, demo.access["url"], storage_state=session.state) as visit:
        visit.page.on("response", note)
        visit.open("palm/t01.area?live=30s")
        visit.page.route("**/login", hold)
        visit.page.context.clear_cookies()
        wait_until(lambda: refusals() >= 3, "several requests are refused as the session ended")
        assert len(left) == 1
        visit.page.unroute_all()  # lets it go on
        visit.wait_for_path("/login")
        visit.page.locator("input[name=token]").fill(demo.access["token"])
        visit.page.keyboard.press("Enter")
        visit.page.locator(CHART).first.wait_for()
        assert visit.page.evaluate("location.hash") == "#/palm/t01.area?live=30s"
        visit.page.get_by_test_id("logout").click()
        visit.wait_for_path("/login")
        visit.page.goto(f"{demo.access['url']}/")
        assert visit.page.evaluate("location.pathname") == "/login"


@pytest.mark.nightly
def test_login_leads_to_the_requested_view(demo: RunningDemo, browser: Browser) -> None:
    with visiting(browser, demo.access["url"]) as visit:
        visit.page.goto(f"{demo.access['url']}/#/palm/t01.area?live=30s")
        visit.page.locator("input[name=token]").fill(demo.access["token"])
        visit.page.keyboard.press("Enter")
        visit.page.locator(CHART).first.wait_for()
        assert visit.page.evaluate("location.hash") == "#/palm/t01.area?live=30s"


@pytest.mark.nightly
def test_page_that_comes_back_from_the_login_can_leave_again(
    demo: RunningDemo, browser: Browser, session: Session
) -> None:
    tries: list[str] = []

    def stay(route: Route) -> None:
        tries.append(route.request.url)
        route.fulfill(status=204)

    def tried() -> int:
        visit.page.evaluate("0")  # takes in what the browser stated meanwhile
        return len(tries)

    with visiting(browser, demo.access["url"], storage_state=session.state) as visit:
        visit.open("palm/t01.area?live=30s")
        visit.page.route("**/login", stay)
        visit.page.context.clear_cookies()
        wait_until(lambda: tried() > 0, "the page tries to leave")
        visit.page.unroute("**/login", stay)
        visit.page.evaluate(
            "dispatchEvent(new PageTransitionEvent('pageshow', { persisted: true })) && undefined"
        )
        visit.wait_for_path("/login")
        assert len(tries) == 1


@pytest.mark.nightly
def test_health_is_unknown_while_the_cloud_cannot_be_reached(visit: Visit) -> None:
    visit.open("")
    badge = visit.page.locator("[data-node=palm] [data-testid=node-health]")
    badge.get_by_text("online", exact=True).wait_for()
    visit.page.context.set_offline(offline=True)
    badge.get_by_text("unknown", exact=True).wait_for()
    visit.page.context.set_offline(offline=False)
    badge.get_by_text("online", exact=True).wait_for()
    visit.troubles.clear()  # the browser itself complains of each request without a network


def test_open_stream_of_a_cloud_that_does_not_answer_is_not_said_to_be_received(
    visit: Visit,
) -> None:
    visit.open("palm/t01.area?live=10s")
    status = visit.page.get_by_test_id("live-status")
    status.and_(visit.page.locator("[data-state=open]")).wait_for()
    visit.page.route("**/api/v1/nodes", lambda route: route.abort())
    status.and_(visit.page.locator("[data-state=waiting]")).wait_for()
    visit.page.unroute("**/api/v1/nodes")
    status.and_(visit.page.locator("[data-state=open]")).wait_for()
    visit.troubles.clear()  # the browser itself complains of each request that fails


@pytest.mark.nightly
def test_answer_that_comes_late_does_not_take_the_place_of_a_newer_one(visit: Visit) -> None:
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    visit.page.add_init_script("AbortSignal.timeout = () => new AbortController().signal")
    visit.open("palm/t01.area?live=10s")
    visit.wait_for_chart(mode="live")
    badge = visit.page.locator("[data-node=palm] [data-testid=node-health]")
    badge.get_by_text("online", exact=True).wait_for()
    visit.page.route("**/api/v1/nodes", hold)
    wait_until(lambda: bool(visit.evaluate("1") and len(held) > 1), "two answers are awaited")
    late, newer = held[:2]
    with visit.page.expect_event("requestfinished", lambda sent: sent == newer.request):
        newer.continue_()
    visit.wait_for_frame()
    with visit.page.expect_event("requestfailed", lambda sent: sent == late.request):
        late.abort()
    text = visit.page.get_by_test_id("window-text")
    shown = text.text_content()
    wait_until(lambda: text.text_content() != shown, "the page goes on")
    assert visit.page.get_by_test_id("banner").is_hidden()
    assert badge.inner_text() != "unknown"
    visit.troubles.clear()  # the browser itself complains of the answer that does not come


@pytest.mark.nightly
def test_chart_without_a_size_is_not_painted_and_comes_back(visit: Visit) -> None:
    visit.open("palm/t01.area?live=10s")
    visit.wait_for_chart(mode="live")
    visit.page.evaluate(
        "document.querySelector('.chart-host').style.cssText = 'width:41px;height:41px'"
    )
    wait_until(lambda: visit.evaluate(CANVAS) < 50, "the chart has no room")
    painted, text = visit.chart()["xMax"], visit.page.get_by_test_id("window-text")
    shown = text.text_content()
    wait_until(lambda: text.text_content() != shown, "it goes on")
    visit.page.get_by_test_id("theme").dispatch_event("click")
    assert visit.chart()["xMax"] == painted
    visit.page.set_viewport_size({"width": 30, "height": 60})
    visit.page.evaluate("document.querySelector('.chart-host').style.cssText = ''")
    visit.wait_for_frame()
    visit.page.set_viewport_size({"width": 1280, "height": 800})
    wait_until(lambda: visit.evaluate(CANVAS) > 300, "it has room again")
    wait_until(lambda: int(visit.chart()["xMax"]) > int(painted), "it is painted again")
    assert float(visit.chart()["plotWidth"]) > 300
    assert visit.troubles == []


@pytest.mark.nightly
def test_chart_that_knows_no_window_yet_says_nothing(visit: Visit) -> None:
    held: list[Route] = []
    streams: list[WebSocketRoute] = []

    def hold(route: Route) -> None:
        held.append(route)

    visit.page.route("**/api/v1/series/**", hold)
    visit.page.route_web_socket("**/api/v1/live?*", lambda stream: streams.append(stream))  # noqa: PLW0108 -- Playwright marks what it is given
    visit.open("palm/t01.area?live=10s")
    wait_until(lambda: bool(visit.evaluate("1") and held and streams), "both are asked for")
    visit.page.get_by_test_id("theme").click()
    visit.wait_for_frame()
    assert "entries" not in visit.chart()
    assert "xMin" not in visit.chart()
    visit.page.unroute_all()  # lets them go on
    wait_until(lambda: int(visit.chart().get("entries", 0)) > 0, "it is painted")


@pytest.mark.nightly
def test_live_view_resumes_without_a_break_when_the_cloud_restarts(
    demo: RunningDemo, browser: Browser, session: Session
) -> None:
    streams: list[WebSocket] = []

    with visiting(browser, demo.access["url"], storage_state=session.state) as visit:
        visit.page.on("websocket", lambda stream: streams.append(stream))  # noqa: PLW0108 -- Playwright marks what it is given
        visit.open("fingertip/t01.capacitance?live=10s")
        status = visit.page.get_by_test_id("live-status")
        status.get_by_text("Receiving").wait_for()
        visit.wait_for_chart(mode="live")
        begin = visit.newest()
        wait_until(lambda: visit.newest() > begin, "events arrive")
        visit.evaluate(STATES)
        demo.children()["cloud"].kill()
        wait_until(lambda: "waiting" in visit.evaluate("states"), "it is noticed")
        wait_until(lambda: visit.evaluate("states.at(-1)") == "open", "it is back", seconds=120)
        assert status.inner_text() == "Receiving"
        resumed = int(visit.chart()["xMax"])

        def healed() -> bool:
            painted = read_plot(visit).painted
            begin = len(painted) // 4
            last = len(painted) - painted[::-1].index(True) if True in painted else 0
            moved = int(visit.chart()["xMax"]) > resumed + 1_000_000_000
            return moved and last > begin and all(painted[begin:last])

        wait_until(healed, "the live band is whole again")
        assert "cursor=" not in streams[0].url
        assert "cursor=" in streams[-1].url
