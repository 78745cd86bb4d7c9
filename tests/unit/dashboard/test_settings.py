"""How a node should be set, and how it says that it is, on the node's page."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from tests.support.processes import wait_until
from tests.unit.dashboard.spoken import listen, nameless

if TYPE_CHECKING:
    from playwright.sync_api import Route

    from tests.unit.dashboard.browsing import Visit

ROWS = """
() => [...document.querySelectorAll("[data-testid=setting]")].map((row) =>
  [...row.querySelectorAll("th, td")].map((cell) => cell.textContent))
"""
WAITING: dict[str, Any] = {
    "node": "fingertip",
    "desired": {"*": {"rate": 50.0}, "t01.capacitance": {"threshold": 1e-13}},
    "desired_at": "2026-01-31T12:00:00.000000000Z",
    "desired_by": 7,
    "reported": {"t01": {"rate": 100.0, "mode": "samples"}},
    "reported_at": {
        "lo": "2026-01-31T12:00:00.000000000Z",
        "hi": "2026-01-31T12:00:00.000001000Z",
    },
    "reported_by": None,
    "settled": False,
}


def test_what_is_desired_and_what_is_reported_stand_side_by_side(visit: Visit) -> None:
    state = dict(WAITING)
    command: dict[str, Any] = {"state": "delivered", "arguments": {"rate": 50.0}, "reason": None}

    def answer(route: Route) -> None:
        found = state if route.request.url.endswith("/state") else command
        route.fulfill(body=json.dumps(found), content_type="application/json")

    visit.page.route("**/api/v1/nodes/fingertip/state", answer)
    visit.page.route("**/api/v1/nodes/fingertip/commands/7", answer)
    visit.open("fingertip")
    settings = visit.page.locator("[data-testid=settings]")
    settings.wait_for()
    # Folded away, so that what the node feels comes first.
    assert not settings.locator("table").is_visible()
    settings.locator("summary").click()
    assert settings.locator("table").is_visible()
    assert nameless(listen(visit)) == {}
    assert visit.evaluate(ROWS) == [
        ["whole node", "rate", "50 Hz", "100 Hznot yet"],
        ["t01", "mode", "–", "samples"],
        ["t01", "rate", "50 Hz", "100 Hznot yet"],
        ["t01.capacitance", "threshold", "100 fF", "–not yet"],
    ]
    note = visit.page.locator("[data-testid=settings-note]")
    assert note.inner_text().endswith("It is not set as desired yet.")
    command.update(state="refused", reason="rate is 50.0; allowed: at most 40")
    failed = settings.locator("[data-failed=true]")
    wait_until(lambda: failed.count() == 2, "the two rows of the command are marked")
    assert command["reason"] in note.inner_text()
    state["reported"] = {"t01": {"rate": 50.0}, "t01.capacitance": {"threshold": 1e-13}}
    state["settled"] = True
    wait_until(lambda: note.inner_text().endswith("It is set as desired."), "it is shown")
    assert "not yet" not in settings.inner_text()


@pytest.mark.nightly
def test_page_of_a_node_of_which_nothing_is_known_shows_no_settings(visit: Visit) -> None:
    empty = WAITING | {"desired": {}, "reported": None, "reported_at": None, "settled": True}
    visit.page.route(
        "**/api/v1/nodes/fingertip/state",
        lambda route: route.fulfill(body=json.dumps(empty), content_type="application/json"),
    )
    visit.open("fingertip")
    # Once it asks again it has taken over the first answer.
    wait_until(lambda: visit.asked("/nodes/fingertip/state") > 1, "it asks again")
    assert visit.page.locator("[data-testid=settings]").is_hidden()
