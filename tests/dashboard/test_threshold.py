"""Questions for a threshold: certain and possible time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.moment import parse_moment
from tests.dashboard.browsing import history

if TYPE_CHECKING:
    from tests.dashboard.browsing import Visit
    from tests.demos import RunningDemo

SECOND = 1_000_000_000


def totals(demo: RunningDemo, start: int, end: int) -> tuple[int, int]:
    """Certain time, and certain and possible time together, as the REST API answers."""
    question = {"above": "5e-12", "start": start, "end": end}
    items: list[dict[str, str]] = []
    cursor: str | None = ""
    while cursor is not None:
        more = {"cursor": cursor} if cursor else {}
        answer = demo.get("/series/palm/t01.energy/threshold", **question, **more)
        items += answer["items"]
        cursor = answer["next"]
    sums = {"certain": 0, "possible": 0}
    for item in items:
        length = min(parse_moment(item["end"]), end) - max(parse_moment(item["start"]), start)
        sums[item["verdict"]] += length
    return sums["certain"], sums["certain"] + sums["possible"]


def test_threshold_totals_equal_the_answer_of_the_api(
    demo: RunningDemo, visit: Visit, recorded: int
) -> None:
    start, end = recorded - 3 * SECOND, recorded
    visit.open(history("palm/t01.energy", start, end))
    visit.wait_for_chart(mode="history")
    visit.page.get_by_test_id("threshold-level").fill("5")
    visit.page.get_by_test_id("threshold-ask").click()
    shown = []
    for name in ("total-certain", "total-possible"):
        total = visit.page.get_by_test_id(name)
        total.wait_for()
        shown.append(int(total.get_attribute("data-ns") or -1))
    certain, at_most = totals(demo, start, end)
    assert 0 < certain < at_most < end - start
    assert shown == [certain, at_most]
    assert "above=5e-12" in visit.page.evaluate("location.href")
