"""A chart: what its pixels say, and how it is worked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import CHART, history, without_events
from tests.unit.dashboard.pixels import FINE, read_plot, samples_of

if TYPE_CHECKING:
    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.replay import Replay

MS = 1_000_000
LIVELY = {"reduced_motion": "no-preference"}
INK = """
() => {
  const root = document.querySelector("[data-testid=chart]");
  const { plotLeft, plotTop, plotWidth, plotHeight, pixelRatio } = root.dataset;
  const box = [plotLeft, plotTop, plotWidth, plotHeight];
  const [left, top, width, height] = box.map((side) => Math.round(side * pixelRatio));
  const pen = root.querySelector("canvas").getContext("2d");
  const inked = (...box) => pen.getImageData(...box).data.filter((_, i) => i % 4 === 3)
    .reduce((sum, alpha) => sum + (alpha > 100), 0);
  return [inked(0, top, left - 2, height), inked(left, top + height + 2, width, 20)];
}
"""
"""How many pixels are painted left of the plot, and below it."""
PICTURES = """
([seconds, most, least]) => new Promise((done) => {
  const { dataset } = document.querySelector("[data-testid=chart]");
  const begin = performance.now();
  const pictures = new Set();
  const frame = (now) => {
    pictures.add(dataset.xMin);
    const passed = (now - begin) / 1000;
    const wanted = passed < seconds || (pictures.size < least && passed < most);
    if (wanted) requestAnimationFrame(frame);
    else done(pictures.size);
  };
  requestAnimationFrame(frame);
})
"""


@pytest.mark.parametrize(
    ("options", "channel", "length", "resolution"),
    [
        ({}, "fingertip/t01.capacitance", 2000 * MS, "hull"),
        ({}, "palm/t01.energy", 150 * MS, "sample"),
        (FINE, "palm/t01.energy", 2000 * MS, "hull"),
        (FINE, "forearm/t01.distance", 20 * MS, "sample"),
        ({}, "forearm/t02.current", 1100 * MS, "hull"),
    ],
)
def test_painted_pixels_enclose_the_samples(
    replay: Replay, visit: Visit, recorded: int, channel: str, length: int, resolution: str
) -> None:
    visit.page.route("**/api/v1/events*", without_events)
    visit.open(history(channel, recorded - length, recorded))
    visit.wait_for_chart(mode="history", resolution=resolution)
    plot = read_plot(visit)
    series = replay.get(f"/series/{channel}", start=plot.start, end=plot.end, points=20_000)
    samples = [one for one in samples_of(series) if plot.start <= one[0] < plot.end]
    assert len(samples) >= 10
    assert [sample for sample in samples if not plot.encloses(*sample)] == []
    area = "".join(plot.columns)
    assert area.count("1") < 0.95 * len(area), "a plot that is painted all over shows nothing"


def test_live_chart_shows_no_break_where_the_stream_follows_the_store(visit: Visit) -> None:
    visit.page.route("**/api/v1/events*", without_events)
    visit.open("fingertip/t01.capacitance?live=10s")
    begin = int(visit.wait_for_chart(mode="live")["xMax"])

    def unbroken() -> bool:
        plot = read_plot(visit)
        assert plot.start < begin - 1000 * MS, "where the stream begins can still be seen"
        painted = plot.painted
        last = len(painted) - painted[::-1].index(True) if True in painted else 0
        return last > 0 and all(painted[painted.index(True) : last])

    wait_until(
        lambda: int(visit.chart()["xMax"]) > begin + 1500 * MS, "the stream has followed the store"
    )
    wait_until(unbroken, "the band is drawn without a break")


@pytest.mark.nightly
def test_zoom_goes_down_to_single_samples(visit: Visit, recorded: int) -> None:
    visit.open(history("palm/t01.energy", recorded - 2000 * MS, recorded))
    visit.wait_for_chart(resolution="hull")
    visit.page.locator(CHART).focus()
    for _ in range(6):
        visit.page.keyboard.press("+")
    facts = visit.wait_for_chart(resolution="sample")
    assert int(facts["xMax"]) - int(facts["xMin"]) == pytest.approx(2000 * MS / 2**6, abs=10)
    assert 25 <= int(facts["entries"]) <= 40


def test_link_opens_the_same_view(visit: Visit, recorded: int) -> None:
    visit.open(history("forearm/t01.distance", recorded - 1000 * MS, recorded))
    visit.wait_for_chart(mode="history")
    visit.page.locator(CHART).focus()
    for key in ("ArrowLeft", "+", "+", "+"):
        visit.page.keyboard.press(key)
    first = visit.wait_for_chart(resolution="sample")
    link = visit.page.evaluate("location.href")
    visit.page.goto("about:blank")
    visit.page.goto(link)
    visit.page.locator(CHART).wait_for()
    second = visit.wait_for_chart(resolution="sample")
    names = ("node", "channel", "xMin", "xMax", "yMin", "yMax", "entries")
    assert {name: second[name] for name in names} == {name: first[name] for name in names}


@pytest.mark.nightly
def test_keys_move_and_zoom_the_window(visit: Visit) -> None:
    visit.open("fingertip/t02.capacitance?live=10s")
    begin = visit.wait_for_chart(mode="live")["xMin"]
    wait_until(lambda: visit.chart()["xMin"] != begin, "the window moves")
    visit.page.locator(CHART).focus()

    def press(key: str) -> tuple[int, int]:
        # Asked of the page itself: `page.url` is not updated while we wait.
        before = visit.page.evaluate("location.href")
        visit.page.keyboard.press(key)
        wait_until(
            lambda: visit.page.evaluate("location.href") != before, f"{key} changes the address"
        )
        facts = visit.wait_for_chart(mode="history")
        return int(facts["xMin"]), int(facts["xMax"])

    start, end = press("ArrowLeft")
    further = press("ArrowLeft")
    assert further == pytest.approx((start - 1000 * MS, end - 1000 * MS), abs=10)
    assert press("ArrowRight") == pytest.approx((start, end), abs=10)
    near = press("+")
    assert near[1] - near[0] == pytest.approx((end - start) / 2, abs=10)
    assert press("-") == pytest.approx((start, end), abs=10)
    visit.page.keyboard.press("l")
    visit.wait_for_chart(mode="live")


@pytest.mark.nightly
def test_samples_that_are_known_are_shown_without_a_question(
    replay: Replay, visit: Visit, recorded: int
) -> None:
    visit.page.route("**/api/v1/events*", without_events)
    visit.open(history("palm/t01.energy", recorded - 150 * MS, recorded - 20 * MS))
    wide = visit.wait_for_chart(mode="history", resolution="sample")
    visit.page.locator("[data-testid=channel]:not(.busy)").wait_for()
    # Once more around the window, by as much as its times may be wrong, if not stated yet.
    known = visit.asked("/series/")
    assert known in {1, 2}
    visit.page.locator(CHART).focus()
    for key in ("+", "+", "ArrowLeft"):
        visit.page.keyboard.press(key)
    near = visit.wait_for_chart(resolution="sample")
    assert visit.asked("/series/") == known
    plot = read_plot(visit)
    series = replay.get("/series/palm/t01.energy", start=plot.start, end=plot.end, points=20_000)
    samples = [one for one in samples_of(series) if plot.start <= one[0] < plot.end]
    assert len(samples) >= 20
    assert [one for one in samples if not plot.encloses(*one)] == []
    assert int(near["xMax"]) - int(near["xMin"]) < int(wide["xMax"]) - int(wide["xMin"])
    for _ in range(4):
        visit.page.keyboard.press("-")
    visit.wait_for_chart(mode="history")
    wait_until(lambda: visit.asked("/series/") > known, "what is not known is asked for")


@pytest.mark.nightly
@pytest.mark.parametrize("options", [{}, FINE])
def test_both_axes_are_labelled(visit: Visit, recorded: int) -> None:
    visit.open(history("palm/t01.energy", recorded - 2000 * MS, recorded))
    visit.wait_for_chart(mode="history")
    values, times = visit.evaluate(INK)
    assert values > 60
    assert times > 60
    assert visit.page.locator(".chart-unit").inner_text().endswith("J")


@pytest.mark.nightly
@pytest.mark.parametrize("options", [LIVELY])
def test_pictures_of_a_live_page_leave_its_layout_and_styles_alone(visit: Visit) -> None:
    visit.open("palm?live=10s")
    visit.wait_for_chart(mode="live")
    session = visit.page.context.new_cdp_session(visit.page)
    session.send("Performance.enable")

    def counts() -> tuple[float, ...]:
        metrics = session.send("Performance.getMetrics")["metrics"]
        stated = {one["name"]: one["value"] for one in metrics}
        return stated["Timestamp"], stated["LayoutCount"], stated["RecalcStyleCount"]

    before = counts()
    pictures = visit.evaluate(PICTURES, [4, 60, 5])
    changes = (now - then for now, then in zip(counts(), before, strict=True))
    seconds, layouts, recalculated = changes
    session.detach()
    assert pictures > 4
    # A picture comes up to 60 times a second.
    texts_and_events = 16 * seconds
    assert layouts < texts_and_events
    assert recalculated < texts_and_events
