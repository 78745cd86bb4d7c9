"""Formulas asked on the page of a channel: marked, summed up, and refused with a reason."""

from __future__ import annotations

import re
from math import ceil, floor
from typing import TYPE_CHECKING
from urllib.parse import quote, urlencode

import numpy as np
import pytest

from eskin.wire.timestamp import parse_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import CHART, history
from tests.unit.dashboard.pixels import CERTAIN, read_plot
from tests.unit.dashboard.spoken import listen, nameless

if TYPE_CHECKING:
    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit

SECOND = 1_000_000_000
CHANNEL = "palm/t01.energy"
FORMULA = "once[0,50ms] t01.energy > 6 pJ"
LOOKS = """
(strip) => {
  const canvas = strip.querySelector("canvas");
  const { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const painted = (x, y) => data[4 * (y * width + x) + 3] > 200;
  const look = (x) => {
    const rows = Array.from({ length: height }, (_, y) => painted(x, y)).filter(Boolean).length;
    const outlined = painted(x, 0) && painted(x, height - 1);
    if (rows === height) return "certain";
    if (outlined) return "possible";
    return rows > 0 && painted(x, height - 1) && !painted(x, 0) ? "impossible" : "other";
  };
  return [{ ...strip.dataset }, Array.from({ length: width }, (_, x) => look(x))];
}
"""
"""What each pixel column of a strip shows, by its shape alone."""


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
    found = demo.get("/monitors/evaluation/time", **asked)
    (most,) = re.findall(
        r"a year: at most ([\d,.]+), with one verdict at each sample",
        live_visit.page.get_by_test_id("formula-false").inner_text(),
    )
    assert 0 < found["false_a_year"] <= float(most.replace(",", "")) < 1.1 * found["false_a_year"]
    time = found["time_s"]
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


@pytest.mark.nightly
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


def open_formula(visit: Visit, start: int, end: int) -> dict[str, str]:
    """Open a window of the channel with the formula asked, until its strip is painted."""
    question = urlencode({"formula": FORMULA}, quote_via=quote)
    visit.open(f"{history(CHANNEL, start, end)}&{question}")
    facts = visit.wait_for_chart(mode="history")
    visit.page.locator(f'[data-testid=verdict-strip][data-start="{start}"]').wait_for()
    visit.wait_for_answers()
    return facts


def test_strip_under_the_chart_shows_all_verdicts(
    demo: RunningDemo, live_visit: Visit, live_recorded: int
) -> None:
    start, end = live_recorded - 3 * SECOND, live_recorded
    facts = open_formula(live_visit, start, end)
    strip = live_visit.page.get_by_test_id("verdict-strip")
    said, looks = strip.evaluate(LOOKS)
    assert [int(said["start"]), int(said["end"])] == [start, end]
    chart, box = live_visit.page.locator(CHART).bounding_box(), strip.bounding_box()
    assert chart is not None
    assert box is not None
    assert box["x"] == pytest.approx(chart["x"] + float(facts["plotLeft"]), abs=0.6)
    assert box["width"] == pytest.approx(float(facts["plotWidth"]), abs=0.6)
    items = demo.get("/monitors/evaluation", formula=FORMULA, node="palm", start=start, end=end)
    touched: list[set[str]] = [set() for _ in looks]
    for item in items["items"]:
        assert not item["missing"]
        first, last = (
            (parse_timestamp(item[edge]) - start) * len(looks) / (end - start)
            for edge in ("start", "end")
        )
        for column in range(max(0, floor(first - 1e-6)), min(len(looks), ceil(last + 1e-6))):
            touched[column].add(item["verdict"])
    assert {"certain", "possible", "impossible"} <= set().union(*touched)
    shown = ["possible" if len(each) > 1 else each.pop() for each in touched]
    assert looks == shown


@pytest.mark.nightly
def test_strip_says_why_by_mouse_and_by_key(
    demo: RunningDemo, live_visit: Visit, live_recorded: int
) -> None:
    window = {"start": live_recorded - 3 * SECOND, "end": live_recorded}
    asked = {"formula": FORMULA, "node": "palm"}
    items = demo.get("/monitors/evaluation", **asked, **window, verdict="possible")["items"]
    spans = [(parse_timestamp(item["start"]), parse_timestamp(item["end"])) for item in items]
    first, last = max(spans, key=lambda span: span[1] - span[0])
    start, end = 2 * first - last, 2 * last - first
    open_formula(live_visit, start, end)
    strip = live_visit.page.get_by_test_id("verdict-strip")
    assert "possible for " in (strip.get_attribute("aria-label") or "")
    box = strip.bounding_box()
    assert box is not None
    tip = live_visit.page.locator(".verdict-strip [data-testid=tooltip]")
    strip.hover(position={"x": box["width"] / 2, "y": 5})
    tip.locator("strong").get_by_text("possible", exact=True).wait_for()
    assert "width of the interval" in tip.inner_text()
    assert "coverage" in tip.inner_text()
    strip.hover(position={"x": 3, "y": 5})
    items = demo.get("/monitors/evaluation", **asked, start=start, end=end)["items"]
    tip.locator("strong").get_by_text(items[0]["verdict"], exact=True).wait_for()
    assert " or before" in tip.inner_text()
    assert "because" not in tip.inner_text()
    live_visit.page.mouse.move(0, 0)
    tip.wait_for(state="hidden")
    strip.focus()
    for item in items[:2]:
        live_visit.page.keyboard.press("ArrowRight")
        tip.locator("strong").get_by_text(item["verdict"], exact=True).wait_for()
    live_visit.page.keyboard.press("Escape")
    tip.wait_for(state="hidden")


@pytest.mark.nightly
def test_formula_is_completed_by_key_and_by_mouse(live_visit: Visit, live_recorded: int) -> None:
    page = live_visit.page
    live_visit.open(history(CHANNEL, live_recorded - 3 * SECOND, live_recorded))
    live_visit.wait_for_chart(mode="history")
    page.get_by_text("Ask with a formula").click()
    field, options = page.get_by_test_id("formula"), page.get_by_test_id("completions")
    with page.expect_response(lambda answer: answer.url.endswith("/nodes/palm/channels")):
        field.focus()
    field.press_sequentially("onc")
    options.wait_for()
    assert field.get_attribute("aria-expanded") == "true"
    assert field.get_attribute("role") == "combobox"
    active = page.locator(f"#{field.get_attribute('aria-activedescendant')}")
    assert active.get_attribute("aria-selected") == "true"
    page.keyboard.press("Tab")
    assert field.input_value() == "once[0,"
    options.wait_for(state="hidden")
    field.press_sequentially("50m")
    page.keyboard.press("Enter")
    field.press_sequentially("] t01.")
    options.get_by_role("option").get_by_text("t01.energy", exact=True).click()
    field.press_sequentially(" > 6 ")
    assert options.get_by_role("option").all_inner_texts()[:2] == ["J\nunit", "mJ\nunit"]
    assert field.get_attribute("aria-activedescendant") is None
    for key in ("ArrowDown", "ArrowDown", "ArrowUp", "ArrowUp", "Escape"):
        page.keyboard.press(key)
    options.wait_for(state="hidden")
    page.keyboard.press("ArrowDown")
    field.press_sequentially("p")
    page.keyboard.press("Enter")
    assert field.input_value() == FORMULA
    assert "formula=" not in live_visit.evaluate("location.hash")
    page.keyboard.press("Enter")
    page.get_by_test_id("formula-certain").wait_for()
    assert nameless(listen(live_visit)) == {}
