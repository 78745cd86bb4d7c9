"""Monitors that run on a node, on its page: their verdicts, and a lamp for each output."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any, Final

import httpx
import pytest

from eskin.wire.timestamp import format_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import PHONE
from tests.unit.dashboard.spoken import listen, nameless

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Locator, Route

    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit

START: Final = 1_800_000_000_000_000_000
SHORT_S: Final = 4.5
SECTION: Final = ".node-reflexes"
SETTINGS: Final = {"formula": "t01.capacitance > 95 pF", "on": "possible", "output": "stop"}
LAMP: Final = """
(row) => {
  const lamp = row.querySelector(".lamp");
  return lamp && [getComputedStyle(lamp).fill, lamp.querySelector("path").getAttribute("d")].join();
}
"""
MARK: Final = """
(row) => {
  const look = getComputedStyle(row.querySelector("i"));
  return [look.backgroundColor, look.backgroundImage, look.borderBottom].join();
}
"""


def reflex(name: str, verdict: str | None, level: str | None, **more: Any) -> dict[str, Any]:
    """A monitor as the cloud lists it."""
    time = {"lo": format_timestamp(START), "hi": format_timestamp(START + 1000)}
    latest = {
        "verdict": verdict,
        "time": time,
        "final": True,
        "because": ["width"] if verdict == "possible" else [],
        "coverage": 1.0,
        "current": level is not None,
    }
    return {
        "name": name,
        **SETTINGS,
        "desired": None,
        "reported": SETTINGS,
        "latest": None if verdict is None else latest,
        "level": level,
        **more,
    }


class Answers:
    """What the cloud says of a node's monitors, which may change."""

    def __init__(self, visit: Visit, *items: dict[str, Any]) -> None:
        self.items = list(items)
        visit.page.route("**/api/v1/nodes/fingertip/monitors", self._answer)

    def _answer(self, route: Route) -> None:
        body = json.dumps({"items": self.items, "next": None})
        route.fulfill(body=body, content_type="application/json")


def row(visit: Visit, name: str) -> Locator:
    return visit.page.locator(f"[data-testid=reflex][data-monitor={name}]")


@pytest.mark.nightly
def test_verdicts_and_levels_look_different_and_are_said_in_words(visit: Visit) -> None:
    Answers(
        visit,
        reflex("sure", "certain", "on"),
        reflex("open", "possible", "on"),
        reflex("clear", "impossible", "off"),
        reflex("silent", "certain", None),
        reflex("new", None, None),
    )
    visit.open("fingertip", shows="[data-testid=reflex]")
    words = {name: row(visit, name).inner_text() for name in ("sure", "open", "clear", "silent")}
    assert "stop on" in words["sure"]
    assert "certain since" in words["sure"]
    assert "possible by width since" in words["open"]
    assert "stop off" in words["clear"]
    assert "impossible since" in words["clear"]
    assert "stop unknown" in words["silent"]
    assert "unknown now; certain at" in words["silent"]
    assert "no verdict yet" in row(visit, "new").inner_text()
    # Both that are on have the same lamp.
    assert len({row(visit, name).evaluate(LAMP) for name in words}) == len(words) - 1
    assert len({row(visit, name).evaluate(MARK) for name in words}) == len(words)
    assert nameless(listen(visit)) == {}


@pytest.mark.nightly
def test_lamp_follows_the_node(visit: Visit) -> None:
    answers = Answers(visit, reflex("grip", "impossible", "off"))
    visit.open("fingertip", shows="[data-testid=reflex]")
    grip = row(visit, "grip")
    assert "not as desired yet" not in grip.inner_text()
    answers.items = [reflex("grip", "certain", "on", desired=SETTINGS | {"on": "certain"})]
    wait_until(lambda: grip.get_attribute("data-level") == "on", "the lamp is on")
    assert grip.get_attribute("data-verdict") == "certain"
    assert "not as desired yet" in grip.inner_text()


@pytest.mark.nightly
def test_node_without_monitors_shows_no_reflexes(visit: Visit) -> None:
    visit.open("fingertip")
    wait_until(lambda: visit.asked("/nodes/fingertip/monitors") > 0, "it is asked")
    visit.wait_for_answers()
    assert visit.page.locator(SECTION).is_hidden()


@pytest.fixture
def commanded(demo: RunningDemo) -> Iterator[None]:
    """A monitor runs on a node of the demo, whose taxel is pressed twice a second."""
    headers = {"Authorization": f"Bearer {demo.access['token']}"}
    url = f"{demo.access['url']}/api/v1/nodes/fingertip/commands"
    settings = SETTINGS | {"formula": "t01.capacitance > 60 pF"}
    with httpx.Client(headers=headers, timeout=60) as client:
        for arguments in (settings, {}):
            body = {"name": "monitor", "arguments": {"monitor": "grip", **arguments}}
            assert client.post(url, json=body).status_code == 202
            if arguments:
                yield


@pytest.mark.nightly
@pytest.mark.usefixtures("commanded")
def test_each_statement_of_a_running_node_is_shown_soon(live_visit: Visit) -> None:
    live_visit.open("fingertip", shows="[data-testid=reflex]")
    grip = row(live_visit, "grip")
    grip.get_by_text("since").wait_for()
    found, begin = set(), time.monotonic()
    while time.monotonic() < begin + SHORT_S:
        found.add(grip.locator(".reflex-verdict").inner_text())
        live_visit.page.wait_for_timeout(200)
    # It asks by itself each 5 s only.
    assert len(found) > 2
    levels = {"impossible": "off", "possible": "on", "certain": "on"}
    state = grip.evaluate("(one) => [one.dataset.verdict, one.dataset.level]")
    assert state[1] == levels[state[0]]


@pytest.mark.nightly
@pytest.mark.parametrize("options", [PHONE])
def test_reflexes_fit_a_phone(visit: Visit) -> None:
    formula = (
        "once[0,200ms] rise(t02.capacitance > 140 pF) or historically[0,2s] t01.capacitance > 9 pF"
    )
    Answers(visit, reflex("squeeze", "possible", "on", formula=formula))
    visit.open("fingertip", shows="[data-testid=reflex]")
    wide = visit.page.locator(SECTION).evaluate("(one) => [one.scrollWidth, one.clientWidth]")
    assert wide[0] <= wide[1]
