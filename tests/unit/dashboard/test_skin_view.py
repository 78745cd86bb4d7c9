"""The skin as its frames say it: live and in the past, by mouse, by keys and in words."""

from __future__ import annotations

import json
import re
import time
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest

from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import PHONE, history
from tests.unit.dashboard.conftest import watched
from tests.unit.dashboard.skin_cloud import LOOP_NS, PERIOD_NS, STRETCH_NS, SkinCloud
from tests.unit.dashboard.skin_vectors import FILE, document

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, Locator, Route

    from tests.unit.dashboard.browsing import Visit

VIEW: Final = "[data-testid=skin-view]"
MOVING: Final = {"reduced_motion": "no-preference"}
OBSERVE: Final = """
() => {
  window.seen = [];
  const take = (list) => window.seen.push(
    ...list.getEntriesByName("eskin.picture").map(({ detail }) => detail));
  new PerformanceObserver(take).observe({ type: "measure" });
}
"""
COLOURS: Final = """
() => {
  const canvas = document.querySelector(".skin-canvas");
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return new Set(new Uint32Array(data.buffer)).size;
}
"""
"""How many colours the picture has: two where all is hatched, besides the ground and the edge."""


@pytest.fixture(scope="module")
def skins() -> Iterator[SkinCloud]:
    """A cloud with two skins."""
    with SkinCloud() as running:
        yield running


@pytest.fixture
def visit(skins: SkinCloud, browser: Browser, options: dict[str, Any]) -> Iterator[Visit]:
    """A page of it."""
    skins.mode = "normal"
    yield from watched(browser, skins.url, options)


@pytest.fixture
def settled(skins: SkinCloud) -> int:
    """An instant (ns) in the past at which a loop ends."""
    return skins.end // LOOP_NS * LOOP_NS - LOOP_NS


def view(visit: Visit, node: str = "hand") -> Locator:
    return visit.page.locator(f"{VIEW}[data-node={node}]")


def fact(visit: Visit, name: str) -> int:
    return int(view(visit).get_attribute(f"data-{name}") or 0)


def wait_for_picture(visit: Visit) -> None:
    wait_until(lambda: fact(visit, "newest") > 0, "the skin is drawn")


def interval(text: str, unit: str) -> tuple[float, float]:
    """Bounds as they are printed, such as ``4.21–4.45 N``."""
    found = re.search(rf"([\d.]+)(?:–([\d.]+))? (m?){unit}$", text)
    assert found is not None, text
    scale = 1e-3 if found[3] else 1.0
    return float(found[1]) * scale, float(found[2] or found[1]) * scale


def test_vectors_for_the_skin_model_are_current() -> None:
    """Write them anew by ``python -m tests.unit.dashboard.skin_vectors``."""
    assert json.loads(FILE.read_text()) == json.loads(json.dumps(document()))


@pytest.mark.parametrize("options", [MOVING])
def test_hand_is_drawn_as_it_is_touched_in_real_time(visit: Visit) -> None:
    visit.open("", shows=VIEW)
    wait_for_picture(visit)
    visit.evaluate(OBSERVE)
    wait_until(lambda: visit.evaluate("() => window.seen.length") >= 60, "60 pictures were painted")
    seen = visit.evaluate("() => window.seen")
    ages = [one["painted_ms"] - int(one["sample_ns"]) / 1e6 for one in seen]
    samples = [int(one["sample_ns"]) for one in seen]
    assert {one["node"] for one in seen} == {"hand"}
    assert all(sample % PERIOD_NS == 0 for sample in samples)
    assert samples == sorted(set(samples))
    assert 0 < float(np.median(ages)) < 1000
    assert visit.evaluate(COLOURS) > 20


def test_contacts_are_labelled_with_forces_that_the_cloud_stated(
    skins: SkinCloud, visit: Visit, settled: int
) -> None:
    visit.open(history("hand", settled - LOOP_NS, settled), shows=VIEW)
    wait_for_picture(visit)
    labels = visit.page.get_by_test_id("contact-label")
    labels.first.wait_for()
    stated = skins.worlds["hand"].contacts_at(settled // STRETCH_NS - 1)["cores"]
    wait_until(lambda: labels.count() == len(stated), "each contact has a label")
    for text, core in zip(labels.all_inner_texts(), stated, strict=True):
        lo, hi = interval(text, "N")
        assert lo <= core["force"][0] <= core["force"][1] <= hi
        assert hi - lo < 1.2 * (core["force"][1] - core["force"][0])


@pytest.mark.nightly
def test_click_opens_a_taxels_chart_and_escape_closes_it(visit: Visit) -> None:
    visit.open("hand", shows=VIEW)
    wait_for_picture(visit)
    box = visit.page.locator(".skin-canvas").bounding_box()
    assert box is not None
    visit.page.mouse.click(box["x"] + box["width"] * 0.5, box["y"] + box["height"] * 0.7)
    panel = visit.page.get_by_test_id("channel")
    panel.wait_for()
    channel = panel.get_attribute("data-channel") or ""
    assert f"taxels={channel.partition('.')[0]}" in visit.evaluate("location.hash")
    visit.wait_for_chart(mode="live")
    before = visit.newest()
    wait_until(lambda: visit.newest() > before, "the chart is fed by the frames")
    visit.page.reload()
    panel.wait_for()
    visit.page.get_by_test_id("skin-stage").focus()
    visit.page.keyboard.press("Escape")
    panel.wait_for(state="detached")
    assert "taxels" not in visit.evaluate("location.hash")


@pytest.mark.nightly
def test_box_opens_the_charts_of_the_hardest_pressed_taxels(visit: Visit) -> None:
    visit.open("hand", shows=VIEW)
    wait_for_picture(visit)
    box = visit.page.locator(".skin-canvas").bounding_box()
    assert box is not None
    visit.page.mouse.move(box["x"] + box["width"] * 0.2, box["y"] + box["height"] * 0.6)
    visit.page.mouse.down()
    visit.page.mouse.move(box["x"] + box["width"] * 0.6, box["y"] + box["height"] * 0.9, steps=3)
    visit.page.mouse.up()
    panels = visit.page.get_by_test_id("channel")
    wait_until(lambda: panels.count() == 12, "twelve charts are open")
    assert "12 hardest pressed of" in visit.page.locator(".skin-note").inner_text()
    visit.page.get_by_test_id("close-charts").click()
    wait_until(lambda: panels.count() == 0, "all are closed")


@pytest.mark.nightly
def test_keys_move_between_taxels_and_words_name_them(visit: Visit) -> None:
    visit.open("glove", shows=VIEW)
    visit.page.get_by_test_id("skin-stage").focus()
    words = visit.page.get_by_test_id("skin-taxel")
    found = set()
    for key in ("ArrowUp", "ArrowUp", "ArrowRight"):
        visit.page.keyboard.press(key)
        wait_until(lambda: words.inner_text().partition(":")[0] not in found, "another taxel")
        found.add(words.inner_text().partition(":")[0])
    name = words.inner_text().partition(":")[0]
    spoken = visit.page.get_by_test_id("skin-spoken")
    wait_until(lambda: f"{name}:" in (spoken.text_content() or ""), "a screen reader hears it")
    assert re.search(r"[Cc]ontact", spoken.text_content() or "")
    visit.page.keyboard.press("Enter")
    panel = visit.page.locator(f"[data-channel='{name}.pressure'][data-testid=channel]")
    panel.wait_for()


@pytest.mark.nightly
def test_space_stops_the_picture_and_the_film_plays_on(visit: Visit) -> None:
    visit.open("hand", shows=VIEW)
    wait_for_picture(visit)
    visit.page.get_by_test_id("skin-stage").focus()
    visit.page.keyboard.press(" ")
    wait_until(lambda: visit.window() is not None, "the address names a window")
    clock = visit.page.get_by_test_id("film-clock")
    visit.wait_for_answers()
    stopped = fact(visit, "newest")
    visit.page.get_by_test_id("film-strip").press("Home")
    wait_until(lambda: fact(visit, "newest") < stopped, "the position has moved")
    begun = fact(visit, "newest")
    before = clock.inner_text()
    visit.page.get_by_test_id("film-play").click()
    wait_until(lambda: fact(visit, "newest") > begun + 2 * STRETCH_NS, "the film plays")
    assert clock.inner_text() != before
    visit.page.get_by_test_id("film-live").click()
    wait_until(lambda: visit.window() is None, "live again")
    wait_until(lambda: fact(visit, "newest") > time.time_ns() - 5 * 10**9, "the present is drawn")


def test_picture_of_the_past_is_that_of_the_store(
    skins: SkinCloud, visit: Visit, settled: int
) -> None:
    world = skins.worlds["glove"]
    visit.open(history("glove", settled - 2 * 10**9, settled), shows=VIEW)
    visit.page.get_by_test_id("skin-stage").focus()
    words = visit.page.get_by_test_id("skin-taxel")
    visit.page.keyboard.press("ArrowUp")
    wait_until(lambda: "Pa" in words.inner_text(), "a taxel of the past is known")
    visit.wait_for_answers()
    name, _, text = words.inner_text().partition(": ")
    column = world.taxels.index(name)
    rows = slice(-4, None)
    lo, hi = (side[rows, column] for side in (world.recorded[0].lo, world.recorded[0].hi))
    numbers = [float(one.replace("−", "-")) for one in re.findall(r"−?[\d.]+", text)]
    scale = 1e3 if "kPa" in text else 1.0
    assert numbers[0] * scale <= lo[-1]
    assert numbers[1] * scale >= hi[-1]
    assert numbers[0] * scale >= lo.min() - 100
    assert numbers[1] * scale <= hi.max() + 100


def test_silent_skin_is_unknown(skins: SkinCloud, visit: Visit) -> None:
    visit.open("hand", shows=VIEW)
    wait_for_picture(visit)
    skins.mode = "silent"
    visit.page.get_by_test_id("notice-stale").wait_for()
    assert visit.page.get_by_test_id("skin-total").inner_text() == "Contacts unknown"
    assert visit.evaluate(COLOURS) <= 4
    wait_until(
        lambda: (
            "Nothing is known" in (visit.page.get_by_test_id("skin-spoken").text_content() or "")
        ),
        "a screen reader hears it",
    )
    skins.mode = "normal"
    visit.page.get_by_test_id("notice-stale").wait_for(state="detached")
    wait_until(lambda: visit.evaluate(COLOURS) > 20, "the skin is known again")


def test_missing_page_is_unknown_while_the_others_go_on(skins: SkinCloud, visit: Visit) -> None:
    skins.mode = "missing page"
    visit.open("hand", shows=VIEW)
    wait_for_picture(visit)
    summary = visit.page.get_by_test_id("skin-summary")
    wait_until(lambda: "2,11" in summary.inner_text(), "the taxels of a page are unknown")
    before = fact(visit, "newest")
    wait_until(lambda: fact(visit, "newest") > before, "the others are drawn")


@pytest.mark.nightly
@pytest.mark.parametrize("drawn", [False, True])
def test_frames_of_the_past_are_not_shown_as_the_present(
    skins: SkinCloud, visit: Visit, *, drawn: bool
) -> None:
    if drawn:
        visit.open("glove", shows=VIEW)
        wait_until(lambda: visit.evaluate(COLOURS) > 4, "the skin is known")
    skins.mode = "past"
    visit.open("glove", shows=VIEW)
    visit.page.get_by_test_id("notice-stale").wait_for()
    row = visit.page.get_by_test_id("channel-row").first.locator(".channel-value")
    browser = visit.page.get_by_test_id("channel-browser")
    if browser.get_attribute("open") is None:
        browser.locator("summary").first.click()
    wait_until(lambda: row.inner_text() == "–", "the list of channels states no value, either")
    assert visit.page.get_by_test_id("skin-total").inner_text() == "Contacts unknown"
    assert "21 unknown" in visit.page.get_by_test_id("skin-summary").inner_text()
    assert visit.evaluate(COLOURS) <= 4
    skins.mode = "normal"
    visit.page.get_by_test_id("notice-stale").wait_for(state="detached")
    wait_until(lambda: visit.evaluate(COLOURS) > 4, "the skin is known again")
    wait_until(lambda: "Pa" in row.inner_text(), "the list of channels states a value again")


def test_late_and_left_out_frames_are_stated(skins: SkinCloud, visit: Visit) -> None:
    skins.mode = "lagging"
    visit.open("hand", shows=VIEW)
    warning = visit.page.get_by_test_id("skin-warning")
    wait_until(lambda: "late" in warning.inner_text(), "data is late")
    wait_until(lambda: "left out" in warning.inner_text(), "frames were left out")


def test_frames_that_were_compacted_before_they_came_are_said_to_be_left_out(
    skins: SkinCloud, visit: Visit
) -> None:
    skins.mode = "compacted"
    visit.open("hand", shows=VIEW)
    warning = visit.page.get_by_test_id("skin-warning")
    wait_until(lambda: "left out" in warning.inner_text(), "frames were left out")


def test_closed_stream_is_opened_again(skins: SkinCloud, visit: Visit) -> None:
    visit.open("glove", shows=VIEW)
    status = visit.page.get_by_test_id("live-status")
    wait_until(lambda: status.get_attribute("data-state") == "open", "the stream is open")
    skins.mode = "closed"
    wait_until(lambda: status.get_attribute("data-state") == "waiting", "it is waited for")
    skins.mode = "normal"
    wait_until(lambda: status.get_attribute("data-state") == "open", "it is open again")
    assert all("WebSocket" in trouble for trouble in visit.troubles)
    visit.troubles.clear()  # the browser itself complains of each refusal


def test_channels_are_grouped_filtered_and_made_when_seen(visit: Visit) -> None:
    visit.open("glove", shows=VIEW)
    browser = visit.page.get_by_test_id("channel-browser")
    browser.locator("summary").first.click()
    groups = visit.page.get_by_test_id("channel-group")
    assert groups.evaluate_all("(all) => all.map((one) => one.dataset.quantity)") == [
        "pressure",
        "temperature",
    ]
    visit.open("hand", shows=VIEW)
    browser.locator("summary").first.click()
    rows = visit.page.get_by_test_id("channel-row")
    rows.first.wait_for()
    assert rows.count() < 40
    visit.page.get_by_test_id("channel-filter").fill("t83 pressure")
    wait_until(
        lambda: rows.first.get_attribute("data-channel") == "t8300.pressure", "the list is filtered"
    )
    assert "100 of 8,400" in groups.first.inner_text()
    rows.first.click()
    visit.wait_for_chart(mode="live")
    assert "#/hand/t8300.pressure" in visit.evaluate("location.hash")
    before = visit.newest()
    wait_until(lambda: visit.newest() > before, "its chart is fed by the frames")


@pytest.mark.nightly
def test_quantity_can_be_chosen(visit: Visit) -> None:
    visit.open("glove", shows=VIEW)
    visit.page.get_by_test_id("skin-quantity").select_option("temperature")
    ends = visit.page.locator(".scale-ends")
    wait_until(lambda: "°C" in ends.inner_text(), "the scale is of temperatures")
    visit.page.get_by_test_id("skin-stage").focus()
    visit.page.keyboard.press("ArrowDown")
    words = visit.page.get_by_test_id("skin-taxel")
    wait_until(lambda: "°C" in words.inner_text(), "a taxel's temperature is stated")


@pytest.mark.nightly
@pytest.mark.parametrize("options", [PHONE])
@pytest.mark.parametrize("place", ["", "hand"])
def test_phone_shows_the_whole_hand_and_overflows_nowhere(visit: Visit, place: str) -> None:
    visit.open(place, shows=VIEW)
    wait_for_picture(visit)
    visit.wait_for_answers()
    page, window = visit.evaluate("() => [document.documentElement.scrollWidth, innerWidth]")
    assert window == 390
    assert page <= window
    box = visit.page.locator(".skin-canvas").first.bounding_box()
    assert box is not None
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 390
    assert box["y"] + box["height"] <= 844


@pytest.mark.nightly
def test_overview_begins_with_the_largest_skin(visit: Visit) -> None:
    def turn(route: Route) -> None:
        answer = route.fetch()
        items = sorted(answer.json()["items"], key=lambda item: str(item["id"]))
        route.fulfill(response=answer, json={"items": items, "next": None})

    visit.page.route("**/api/v1/nodes", turn)
    visit.open("", shows=VIEW)
    view(visit, "glove").wait_for(state="attached")
    shown = visit.page.locator(VIEW).evaluate_all("(all) => all.map((one) => one.dataset.node)")
    assert shown == ["hand", "glove"]


@pytest.mark.usefixtures("skins")
def test_no_contact_is_claimed_where_nothing_is_known(visit: Visit) -> None:
    visit.open("hand?from=2020-01-01T00:00:00Z&to=2020-01-01T00:01:00Z", shows=VIEW)
    total = visit.page.get_by_test_id("skin-total")
    visit.page.get_by_text(re.compile(r"[1-9][\d,]* unknown")).first.wait_for()
    assert total.inner_text() == "Contacts unknown"
