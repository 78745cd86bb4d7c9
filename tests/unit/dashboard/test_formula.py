"""Formulas asked on the page of a channel: marked, summed up, and refused with a reason."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.wire.timestamp import parse_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import history
from tests.unit.dashboard.pixels import CERTAIN, read_plot

if TYPE_CHECKING:
    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit

SECOND = 1_000_000_000
CHANNEL = "palm/t01.energy"
FORMULA = "once[0,50ms] t01.energy > 6 pJ"


def test_formula_is_marked_and_summed_up(
    demo: RunningDemo, live_visit: Visit, live_recorded: int
) -> None:
    start, end = live_recorded - 3 * SECOND, live_recorded
    live_visit.open(history(CHANNEL, start, end))
    live_visit.wait_for_chart(mode="history")
    live_visit.page.get_by_text("Ask with a formula").click()
    live_visit.page.get_by_test_id("formula").fill(FORMULA)
    live_visit.page.keyboard.press("Enter")
    shown = []
    for name in ("formula-certain", "formula-possible"):
        total = live_visit.page.get_by_test_id(name)
        total.wait_for()
        shown.append(int(total.get_attribute("data-ns") or -1))
    asked = {"formula": FORMULA, "node": "palm", "start": start, "end": end}
    time = demo.get("/monitors/evaluation/time", **asked)["time_s"]
    assert 0 < time["lo"] < time["hi"] < 3
    assert shown == [round(time["lo"] * SECOND), round(time["hi"] * SECOND)]
    items = demo.get("/monitors/evaluation", **asked, verdict="certain")["items"]
    spans = [(parse_timestamp(item["start"]), parse_timestamp(item["end"])) for item in items]
    middles = [int(np.mean(span)) for span in spans]
    lane = [read_plot(live_visit).column(middle) for middle in middles]

    def painted() -> bool:
        columns = read_plot(live_visit, CERTAIN).columns
        return all(columns[column][-9] == "1" for column in lane)

    wait_until(painted, "all certain stretches are marked")
    live_visit.page.reload()
    live_visit.page.get_by_test_id("formula-certain").wait_for()
    assert live_visit.page.get_by_test_id("formula").input_value() == FORMULA


def test_formula_that_is_refused_says_where(live_visit: Visit, live_recorded: int) -> None:
    live_visit.open(history(CHANNEL, live_recorded - 3 * SECOND, live_recorded))
    live_visit.wait_for_chart(mode="history")
    live_visit.page.get_by_text("Ask with a formula").click()
    live_visit.page.get_by_test_id("formula").fill("t01.energy > 6 pF")
    live_visit.page.get_by_test_id("formula-ask").click()
    live_visit.page.get_by_test_id("formula-answer").get_by_text("units do not fit").wait_for()
    live_visit.troubles.clear()  # the browser itself complains of the refusal
    live_visit.page.get_by_test_id("formula").fill(FORMULA)
    live_visit.page.get_by_test_id("formula-ask").click()
    live_visit.page.get_by_test_id("formula-certain").wait_for()
