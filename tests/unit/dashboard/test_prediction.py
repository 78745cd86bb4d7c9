"""A channel beside what a model predicts: the painted tube, the marked anomalies, the sums."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import eskin
from eskin.interval import Interval
from eskin.wire.timestamp import format_timestamp, parse_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import history
from tests.unit.dashboard.pixels import CERTAIN, PREDICTED, read_plot

if TYPE_CHECKING:
    from playwright.sync_api import Route

    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit

SECOND = 1_000_000_000
CHANNEL = "palm/t01.energy"
PARAMETERS = [
    ("minimum_area", "9e-6", "1.1e-5"),
    ("maximum_area", "9e-5", "1.1e-4"),
    ("distance", "9e-4", "1.1e-3"),
    ("voltage", "4.5", "5.5"),
]


def asked(demo: RunningDemo, path: str, **parameters: Any) -> Any:
    """The answer of the API, with parameters that may be repeated."""
    with demo.client() as client:
        answer = client.get(f"/api/v1/series/{CHANNEL}/{path}", params=parameters)
        answer.raise_for_status()
        return answer.json()


@pytest.mark.nightly
@pytest.mark.parametrize("options", [{"device_scale_factor": 1.5}])
def test_painted_tube_encloses_what_is_predicted(live_visit: Visit, live_recorded: int) -> None:
    end = live_recorded - 3600 * SECOND  # nothing was measured then that could be painted over it
    origin = format_timestamp(end - 3 * SECOND)
    question = "&".join(f"parameter={':'.join(each)}" for each in PARAMETERS)
    window = history(CHANNEL, end - 2 * SECOND, end)
    live_visit.open(f"{window}&model=touch.energy&origin={origin}&{question}")
    wait_until(lambda: int(live_visit.chart().get("predicted", 0)) > 100, "the tube is there")
    live_visit.wait_for_chart(mode="history")
    plot = read_plot(live_visit, PREDICTED)
    instants = plot.start + np.linspace(0, plot.end - plot.start - 1, 500).astype(np.int64)
    tube = eskin.models.touch(
        (instants - parse_timestamp(origin)) / SECOND,
        **{name: Interval(float(lo), float(hi)) for name, lo, hi in PARAMETERS},
    ).energy
    predicted = zip(instants.tolist(), tube.inf.tolist(), tube.sup.tolist(), strict=True)
    assert [each for each in predicted if not plot.encloses(*each)] == []
    area = "".join(plot.columns)
    assert area.count("1") < 0.8 * len(area), "a plot that is painted all over shows nothing"


@pytest.mark.nightly
def test_anomalies_are_marked_and_summed_up(
    demo: RunningDemo, live_visit: Visit, live_recorded: int
) -> None:
    start, end = live_recorded - 3 * SECOND, live_recorded
    live_visit.open(history(CHANNEL, start, end))
    live_visit.wait_for_chart(mode="history")
    live_visit.page.locator("[data-testid=compare] summary").focus()
    live_visit.page.keyboard.press("Enter")
    live_visit.page.get_by_label("model", exact=True).select_option("constant")
    live_visit.page.get_by_label("value, lower bound").fill("0")
    live_visit.page.get_by_label("value, upper bound").fill("5")
    live_visit.page.keyboard.press("Enter")
    shown = []
    for name in ("anomalous-certain", "anomalous-possible"):
        total = live_visit.page.get_by_test_id(name)
        total.wait_for()
        shown.append(int(total.get_attribute("data-ns") or -1))
    question = {"model": "constant", "parameter": "value:0:5e-12", "start": start, "end": end}
    time = asked(demo, "anomalies/time", **question)["time_s"]
    assert 0 < time["lo"] < time["hi"] < 3
    assert shown == [round(time["lo"] * SECOND), round(time["hi"] * SECOND)]
    assert "model=constant" in live_visit.page.evaluate("location.href")
    assert "parameter=value%3A0%3A5e-12" in live_visit.page.evaluate("location.href")

    items = asked(demo, "anomalies", **question)["items"]
    spans = [
        (parse_timestamp(item["start"]), parse_timestamp(item["end"]))
        for item in items
        if item["verdict"] == "certain"
    ]
    assert spans
    middles = [(start + end) // 2 for start, end in spans]

    def lane() -> list[bool]:
        return [column[-9] == "1" for column in read_plot(live_visit, CERTAIN).columns]

    columns = [read_plot(live_visit).column(middle) for middle in middles]
    wait_until(lambda: all(lane()[column] for column in columns), "all certain ones are marked")
    assert sum(lane()) / len(lane()) == pytest.approx(time["lo"] / 3, abs=0.1)


@pytest.mark.nightly
def test_answer_that_comes_before_the_models_stays(visit: Visit, recorded: int) -> None:
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    visit.page.route("**/api/v1/models*", hold)
    window = history(CHANNEL, recorded - SECOND, recorded)
    visit.open(f"{window}&model=touch.energy&origin=2026-01-01T00:00:00Z")
    said = visit.page.get_by_test_id("model-answer").get_by_text("minimum_area is missing")
    said.wait_for()
    visit.troubles.clear()  # the browser itself complains of the refusal
    wait_until(lambda: bool(visit.evaluate("1") and held), "the models are asked for")
    (models,) = held
    models.continue_()
    visit.page.get_by_test_id("model-ask").wait_for()
    assert said.is_visible()


@pytest.mark.nightly
def test_what_cannot_be_compared_is_said(visit: Visit, recorded: int) -> None:
    window = history(CHANNEL, recorded - SECOND, recorded)
    visit.open(f"{window}&model=touch.energy&origin=2026-01-01T00:00:00Z")
    answer = visit.page.get_by_test_id("model-answer")
    answer.get_by_text("minimum_area is missing").wait_for()
    visit.troubles.clear()  # the browser itself complains of the refusal
    visit.page.get_by_label("distance, upper bound").fill("0.1")
    visit.page.get_by_test_id("model-ask").click()
    answer.get_by_text("Give distance as").wait_for()
    visit.page.get_by_label("distance, upper bound").fill("1.1")
    visit.page.get_by_test_id("model-ask").click()
    answer.get_by_text("Not as predicted").wait_for()
