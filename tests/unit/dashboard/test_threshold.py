"""Questions for a threshold: certain and possible time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import CHART, history

if TYPE_CHECKING:
    from playwright.sync_api import Route

    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit

SECOND = 1_000_000_000


def totals(demo: RunningDemo, start: int, end: int) -> list[int]:
    """Certain time, and certain and possible time together, as the REST API answers."""
    question = {"above": "5e-12", "start": start, "end": end}
    time = demo.get("/series/palm/t01.energy/time", **question)["time_s"]
    return [round(time[side] * SECOND) for side in ("lo", "hi")]


def test_threshold_totals_equal_the_answer_of_the_api(
    demo: RunningDemo, live_visit: Visit, live_recorded: int
) -> None:
    start, end = live_recorded - 3 * SECOND, live_recorded
    live_visit.open(history("palm/t01.energy", start, end))
    live_visit.wait_for_chart(mode="history")
    live_visit.page.get_by_test_id("threshold-level").fill("5")
    live_visit.page.get_by_test_id("threshold-ask").click()
    shown = []
    for name in ("total-certain", "total-possible"):
        total = live_visit.page.get_by_test_id(name)
        total.wait_for()
        shown.append(int(total.get_attribute("data-ns") or -1))
    certain, at_most = totals(demo, start, end)
    assert 0 < certain < at_most < end - start
    assert shown == [certain, at_most]
    assert "above=5e-12" in live_visit.page.evaluate("location.href")


@pytest.mark.nightly
def test_error_about_a_level_outlasts_live_answers(visit: Visit) -> None:
    visit.open("palm/t01.energy?live=10s")
    level = visit.page.get_by_test_id("threshold-level")
    answer = visit.page.get_by_test_id("threshold-answer")
    level.fill("5")
    visit.page.get_by_test_id("threshold-ask").click()
    wait_until(lambda: visit.asked("/threshold") >= 3, "it is asked again and again")
    level.fill("five")
    visit.page.get_by_test_id("threshold-ask").click()
    answer.get_by_text("is not a number").wait_for()
    before = visit.asked("/threshold")
    end = int(visit.chart()["xMax"])
    wait_until(lambda: int(visit.chart()["xMax"]) > end + 3 * SECOND, "three seconds of live data")
    assert visit.asked("/threshold") == before
    assert "is not a number" in answer.inner_text()
    level.fill("6")
    visit.page.get_by_test_id("threshold-ask").click()
    wait_until(lambda: visit.asked("/threshold") > before, "it is asked again")


@pytest.mark.nightly
def test_slow_answer_is_awaited_while_the_window_moves(visit: Visit) -> None:
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    visit.page.route("**/threshold?*", hold)
    visit.open("palm/t01.energy?live=10s&above=5e-12")
    wait_until(lambda: visit.asked("/threshold") > 0, "it is asked")
    polled = visit.asked("/nodes")
    wait_until(lambda: visit.asked("/nodes") > polled + 3, "it could have been asked again")
    assert visit.asked("/threshold") == 1
    visit.page.unroute("**/threshold?*")  # lets it go on
    visit.page.get_by_test_id("total-certain").wait_for()
    wait_until(lambda: visit.asked("/threshold") > 1, "it is asked again")


@pytest.mark.nightly
def test_error_stays_while_the_window_moves_and_goes_with_its_question(
    visit: Visit, recorded: int
) -> None:
    window = history("palm/t01.energy", recorded - 3 * SECOND, recorded)
    visit.open(f"{window}&above=5e-12")
    level = visit.page.get_by_test_id("threshold-level")
    total = visit.page.get_by_test_id("total-certain")
    total.wait_for()
    level.fill("five")
    visit.page.get_by_test_id("threshold-ask").click()
    visit.wait_for_chart(mode="history")
    asked, polled = visit.asked("/threshold"), visit.asked("/nodes")
    visit.page.locator(CHART).focus()
    visit.page.keyboard.press("ArrowLeft")
    visit.wait_for_window((recorded - 3 * SECOND, recorded))
    # Two at least of these three ask for all nodes, every other second; a question would be first.
    wait_until(lambda: visit.asked("/nodes") > polled + 2, "a question could have been asked")
    assert visit.asked("/threshold") == asked
    assert "is not a number" in visit.page.get_by_test_id("threshold-answer").inner_text()
    assert level.input_value() == "five"
    visit.page.evaluate("(hash) => { location.hash = hash; }", f"#/{window}&above=6e-12")
    total.wait_for()
    assert level.input_value() == "6"
    assert level.get_attribute("aria-invalid") is None


@pytest.mark.nightly
def test_answer_states_how_often_it_began(visit: Visit, recorded: int) -> None:
    start, end = recorded - 3 * SECOND, recorded
    visit.open(history("palm/t01.energy", start, end))
    visit.wait_for_chart(mode="history")
    visit.page.get_by_test_id("threshold-level").fill("0")
    visit.page.get_by_test_id("threshold-ask").click()
    visit.page.get_by_test_id("total-certain").wait_for()
    assert "it began 1 time" in visit.page.get_by_test_id("threshold-answer").inner_text()
