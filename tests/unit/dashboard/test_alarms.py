"""Monitors defined on the page of a channel: their alarms are shown, acknowledged and cleared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import httpx
import pytest

from tests.support.processes import wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit

NAME = "always-on"
FORMULA = "t01.energy > 0 pJ"
SECOND = 1_000_000_000


@pytest.fixture
def without_monitors(demo: RunningDemo) -> Iterator[httpx.Client]:
    """The demo's REST interface; what the test defines is deleted."""
    headers = {"Authorization": f"Bearer {demo.access['token']}"}
    url = f"{demo.access['url']}/api/v1"
    with httpx.Client(base_url=url, headers=headers, timeout=60) as client:
        yield client
        client.delete(f"/monitors/{NAME}")


@pytest.mark.nightly
def test_alarm_is_defined_shown_acknowledged_and_deleted(
    without_monitors: httpx.Client, live_visit: Visit
) -> None:
    page = live_visit.page
    live_visit.open("palm/t01.energy?live=10s")
    live_visit.wait_for_chart(mode="live")
    page.get_by_text("Ask with a formula").click()
    page.get_by_test_id("formula").fill(FORMULA)
    name, error = page.get_by_test_id("watch-name"), page.get_by_test_id("watch-error")
    name.fill("Always on")
    error.wait_for()
    assert name.get_attribute("aria-invalid") == "true"
    watch, answer = page.get_by_test_id("watch"), page.get_by_test_id("watch-answer")
    watch.click()
    assert watch.inner_text() == "Raise an alarm", "nothing is asked with a bad name"
    name.fill(NAME)
    error.wait_for(state="hidden")
    assert name.get_attribute("aria-invalid") == "false"
    watch.click()
    certain = page.get_by_test_id("checked-certain")
    certain.wait_for()
    assert int(certain.get_attribute("data-ns") or 0) > SECOND
    assert "In the last hour it held" in answer.inner_text()
    assert without_monitors.get("/monitors").json()["items"] == []
    page.get_by_test_id("formula").press_sequentially(" ")  # another text was not checked
    assert watch.inner_text() == "Raise an alarm"
    watch.click()
    watch.get_by_text("Raise it").wait_for()
    watch.click()
    alarm = page.locator(f'[data-testid="alarm"][data-monitor="{NAME}"]')
    alarm.wait_for()
    alarm.get_by_test_id("acknowledge").click()
    alarm.get_by_text("acknowledged by").wait_for()
    (raised,) = without_monitors.get("/alarms", params={"monitor": NAME}).json()["items"]
    assert raised["acknowledged"] is not None
    assert str(raised["id"]) == alarm.get_attribute("data-id")
    live_visit.open("", shows="[data-testid=monitors]")
    page.get_by_test_id("monitors").get_by_text("Monitors").click()
    row = page.locator(f'[data-testid="monitor"][data-monitor="{NAME}"]')
    row.get_by_text(FORMULA).wait_for()
    row.get_by_role("button").click()
    row.wait_for(state="detached")
    alarm.wait_for(state="detached")
    wait_until(
        lambda: without_monitors.get("/alarms", params={"state": "raised"}).json()["items"] == [],
        "the alarm of a deleted monitor is cleared",
    )
