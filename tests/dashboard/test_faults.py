"""When the cloud or the session goes away."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.dashboard.browsing import CHART, visiting
from tests.dashboard.pixels import read_plot
from tests.processes import wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Request

    from tests.dashboard.conftest import Session
    from tests.demos import RunningDemo


def test_session_that_ends_leads_to_the_login(
    demo: RunningDemo, browser: Browser, session: Session
) -> None:
    state = session.state
    with visiting(browser, demo.access["url"], storage_state=state) as visit:
        visit.open("")
        visit.page.context.clear_cookies()
        visit.page.wait_for_url("**/login")
        visit.page.locator("input[name=token]").fill(demo.access["token"])
        visit.page.keyboard.press("Enter")
        visit.page.locator(CHART).first.wait_for()
        visit.page.get_by_test_id("logout").click()
        visit.page.wait_for_url("**/login")
        visit.page.goto(f"{demo.access['url']}/")
        assert visit.page.evaluate("location.pathname") == "/login"


def test_live_view_resumes_without_a_break_when_the_cloud_restarts(
    demo: RunningDemo, browser: Browser, session: Session
) -> None:
    sent: list[str | None] = []

    def remember(request: Request) -> None:
        if "/api/v1/live" in request.url:
            sent.append(request.headers.get("last-event-id"))

    with visiting(browser, demo.access["url"], storage_state=session.state) as visit:
        visit.page.on("request", remember)
        visit.open("fingertip/t01.capacitance?live=10s")
        status = visit.page.get_by_test_id("live-status")
        status.get_by_text("Receiving").wait_for()
        entries = int(visit.wait_for_chart(mode="live")["entries"])
        wait_until(lambda: int(visit.chart()["entries"]) > entries, "events arrive")
        demo.children()["cloud"].kill()
        visit.page.locator("[data-testid=live-status][data-state=waiting]").wait_for()
        status.get_by_text("Receiving").wait_for()
        resumed = int(visit.chart()["xMax"])

        def healed() -> bool:
            painted = read_plot(visit).painted
            begin = len(painted) // 4
            last = len(painted) - painted[::-1].index(True) if True in painted else 0
            moved = int(visit.chart()["xMax"]) > resumed + 1_000_000_000
            return moved and last > begin and all(painted[begin:last])

        wait_until(healed, "the live band is whole again", seconds=30)
        assert sent[0] is None
        assert int(sent[-1] or 0) > 0
