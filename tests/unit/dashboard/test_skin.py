"""The skin as a picture: what it shows is what the store says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import history

if TYPE_CHECKING:
    from playwright.sync_api import Route

    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.replay import Replay

CONTACTS = """
() => Object.fromEntries([...document.querySelectorAll("[data-testid=taxel]")].map((mark) =>
  [mark.dataset.taxel, mark.dataset.contact]))
"""
SHAPES = """
() => Object.fromEntries([...document.querySelectorAll("[data-testid=taxel]")].map((mark) =>
  [mark.dataset.taxel, [...mark.querySelectorAll(".shape")]
    .filter((shape) => getComputedStyle(shape).display !== "none")
    .map((shape) => shape.classList[1])[0]]))
"""
LOOK_BACK = 250_000_000


def hulls(replay: Replay, end: int) -> dict[str, tuple[float, float]]:
    """What each taxel measured in the quarter of a second before an instant."""
    window = {"start": end - LOOK_BACK, "end": end, "points": 1}
    found = {}
    for taxel in ("t01", "t02", "t03"):
        series = replay.get(f"/series/fingertip/{taxel}.capacitance", **window)
        known = [(lo, hi) for lo, hi in zip(series["lo"], series["hi"], strict=True) if lo != hi]
        found[taxel] = min(lo for lo, _ in known), max(hi for _, hi in known)
    return found


def judged(hull: tuple[float, float], level: float) -> str:
    if hull[0] > level:
        return "certain"
    return "possible" if hull[1] > level else "impossible"


@pytest.mark.parametrize("taxel", ["t01", "t02", "t03"])
def test_each_taxel_shows_what_its_interval_says_of_the_level(
    replay: Replay, visit: Visit, recorded: int, taxel: str
) -> None:
    known = hulls(replay, recorded)
    visit.open(history("fingertip", recorded - 2_000_000_000, recorded))
    field = visit.page.get_by_test_id("skin-level")
    field.wait_for()
    for level in (0.999 * known[taxel][0], sum(known[taxel]) / 2, 1.001 * known[taxel][1]):
        typed = float(f"{level / 1e-12:.6g}")
        field.fill(str(typed))
        expected: dict[str, Any] = {t: judged(hull, typed * 1e-12) for t, hull in known.items()}
        wait_until(lambda: visit.evaluate(CONTACTS) == expected, f"{expected} at {typed} pF")  # noqa: B023 -- waited for at once
        assert visit.evaluate(SHAPES) == expected


def test_live_skin_knows_every_taxel_and_leads_to_its_channel(visit: Visit) -> None:
    visit.open("fingertip")
    wait_until(
        lambda: (
            len(visit.evaluate(CONTACTS)) == 3
            and "unknown" not in visit.evaluate(CONTACTS).values()
        ),
        "every taxel of the fingertip is known",
    )
    assert visit.page.get_by_test_id("skin-summary").inner_text().startswith("Contact: ")
    visit.page.locator("[data-taxel=t02]").click()
    wait_until(
        lambda: "#/fingertip/t02.capacitance" in visit.evaluate("location.hash"), "it leads there"
    )


@pytest.mark.nightly
def test_skin_that_could_not_be_loaded_is_asked_for_again_wherever_the_window_goes(
    visit: Visit, recorded: int
) -> None:
    def refuse(route: Route) -> None:
        route.fulfill(status=503)

    window = recorded - 2_000_000_000, recorded
    visit.page.route("**/api/v1/nodes/fingertip/taxels*", refuse)
    visit.open(history("fingertip", *window))
    visit.wait_for_answers()
    visit.page.get_by_test_id("earlier").click()
    visit.wait_for_window(window)
    visit.page.unroute("**/api/v1/nodes/fingertip/taxels*")
    visit.page.get_by_test_id("skin").wait_for()
    assert all("503" in trouble for trouble in visit.troubles)
    visit.troubles.clear()  # the browser itself complains of each refusal
