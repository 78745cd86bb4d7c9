"""Going to a stretch of time: typed, or the last hour, day, week or month of the data."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from typing import TYPE_CHECKING

import pytest

from eskin.wire.timestamp import format_timestamp, parse_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import history

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page, Route

    from tests.unit.dashboard.browsing import Visit

SECOND = 1_000_000_000
HOUR = 3600 * SECOND
CHANNEL = "palm/t01.energy"
INDIA = timezone(timedelta(hours=5, minutes=30))
SMALL_PHONE = {"viewport": {"width": 360, "height": 740}, "has_touch": True, "is_mobile": True}


def local(instant: int) -> str:
    """An instant as people in India type it."""
    seconds, rest = divmod(instant, SECOND)
    return f"{datetime.fromtimestamp(seconds, INDIA):%Y-%m-%d %H:%M:%S}.{rest:09d}"


def fields(page: Page) -> tuple[Locator, Locator]:
    return page.get_by_test_id("time-from"), page.get_by_test_id("time-to")


def fill(page: Page, start: str, end: str) -> None:
    for field, text in zip(fields(page), (start, end), strict=True):
        field.fill(text)
    page.get_by_test_id("time-show").click()


@pytest.mark.parametrize("options", [{"timezone_id": "Asia/Kolkata"}])
def test_typed_times_are_those_of_the_address_and_of_the_picture(
    visit: Visit, recorded: int
) -> None:
    visit.open(f"{CHANNEL}?live=10s")
    visit.wait_for_chart(mode="live")
    visit.page.get_by_test_id("times").click()
    assert "UTC+05:30" in visit.page.get_by_test_id("time-zone").inner_text()
    start, end = recorded - 2 * SECOND + 1, recorded
    fill(visit.page, local(start), local(end))
    assert visit.wait_for_window(None) == (start, end)
    assert int(visit.wait_for_chart(mode="history")["entries"]) > 0
    fill(visit.page, format_timestamp(start - SECOND), format_timestamp(end))
    assert visit.wait_for_window((start, end)) == (start - SECOND, end)
    # What is shown then is written as it is read: local, to the nanosecond.
    shown = [parse_local(field.input_value()) for field in fields(visit.page)]
    assert shown == [start - SECOND, end]
    visit.page.get_by_test_id("zoom-in").click()
    near = visit.wait_for_window((start - SECOND, end))
    assert tuple(parse_local(field.input_value()) for field in fields(visit.page)) == near
    visit.page.go_back()
    assert visit.wait_for_window(near) == (start, end)
    visit.page.go_back()
    visit.wait_for_chart(mode="live")


def parse_local(text: str) -> int:
    """The instant that people in India mean."""
    day, _, rest = text.partition(".")
    seconds = datetime.fromisoformat(day).replace(tzinfo=INDIA).astimezone(UTC).timestamp()
    return round(seconds) * SECOND + int(rest.ljust(9, "0"))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("start", "end", "wrong", "said"),
    [
        ("yesterday", "2026-01-31 12:00:00", 0, '"yesterday" is not a time'),
        ("2026-01-31 12:00:00", "", 1, 'The field "to" is empty'),
        ("2026-02-30 12:00:00", "2026-03-31 12:00:00", 0, '"2026-02-30 12:00:00" is not a time'),
        (
            "2026-01-31 12:00:01",
            "2026-01-31 12:00:00",
            1,
            "after the start: 2026-01-31 12:00:00 is not after 2026-01-31 12:00:01.",
        ),
    ],
)
def test_what_is_no_range_is_said_beside_the_field(
    visit: Visit, recorded: int, start: str, end: str, wrong: int, said: str
) -> None:
    window = recorded - SECOND, recorded
    visit.open(history(CHANNEL, *window))
    visit.wait_for_window(None)
    visit.page.get_by_test_id("times").click()
    fill(visit.page, start, end)
    error = visit.page.get_by_test_id("time-error")
    error.get_by_text(said).wait_for()
    marks = [field.get_attribute("aria-invalid") for field in fields(visit.page)]
    assert marks == ["true" if field == wrong else "false" for field in range(2)]
    assert fields(visit.page)[wrong].evaluate("(field) => field === document.activeElement")
    assert visit.window() == window
    # What is being typed stays wherever the window goes, with its error.
    visit.page.get_by_test_id("earlier").click()
    visit.wait_for_window(window)
    assert fields(visit.page)[0].input_value() == start
    assert said in error.inner_text()
    fill(visit.page, format_timestamp(recorded - 2 * SECOND), format_timestamp(recorded))
    wait_until(lambda: visit.window() == (recorded - 2 * SECOND, recorded), "it goes there")
    assert error.inner_text() == ""


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "length"), [("1h", 1), ("24h", 24), ("7d", 7 * 24), ("30d", 30 * 24)]
)
def test_last_is_meant_of_the_data_and_not_of_our_clock(
    visit: Visit, name: str, length: int
) -> None:
    ends: list[int] = []

    def shift(route: Route) -> None:
        """As of a node whose clock is sixty days behind."""
        answer = route.fetch()
        items = [item for item in answer.json()["items"] if item["id"] in CHANNEL]
        for item in items:
            first, last = (parse_timestamp(item[key]) - 60 * 24 * HOUR for key in ("first", "last"))
            item.update(first=format_timestamp(first), last=format_timestamp(last))
            ends.append(last + item["dt"])
        route.fulfill(response=answer, json={"items": items, "next": None})

    visit.page.route_web_socket("**/api/v1/live?*", lambda _: None)  # nothing comes
    visit.page.route("**/api/v1/nodes/palm/channels*", shift)
    visit.open(f"{CHANNEL}?live=10s")
    visit.page.get_by_test_id("times").click()
    visit.page.get_by_test_id(f"last-{name}").click()
    start, end = visit.wait_for_window(None)
    assert end in ends
    assert end - start == length * HOUR


@pytest.mark.nightly
def test_last_hour_ends_with_the_newest_data(visit: Visit, recorded: int) -> None:
    visit.open("palm?live=10s")
    visit.wait_for_chart(mode="live")
    visit.page.get_by_test_id("times").click()
    visit.page.get_by_test_id("last-1h").click()
    start, end = visit.wait_for_window(None)
    assert end - start == HOUR
    assert end >= recorded


@pytest.mark.nightly
def test_times_are_worked_by_keys(visit: Visit, recorded: int) -> None:
    visit.open(history(CHANNEL, recorded - SECOND, recorded))
    before = visit.wait_for_window(None)
    focused = "() => document.activeElement.getAttribute('data-testid')"
    keyboard = visit.page.keyboard
    toggle = visit.page.get_by_test_id("times")
    toggle.focus()
    keyboard.press("Enter")
    assert toggle.get_attribute("aria-expanded") == "true"
    assert visit.evaluate(focused) == "last-1h"
    for expected in ("last-24h", "last-7d", "last-30d", "time-from"):
        keyboard.press("Tab")
        assert visit.evaluate(focused) == expected
    keyboard.press("ControlOrMeta+a")
    keyboard.type(format_timestamp(before[0] - SECOND))
    keyboard.press("Enter")
    assert visit.wait_for_window(before) == (before[0] - SECOND, before[1])
    keyboard.press("Escape")
    assert visit.page.get_by_test_id("time-form").is_hidden()
    assert toggle.get_attribute("aria-expanded") == "false"
    assert visit.evaluate(focused) == "times"
    name = "(field) => field.labels[0].textContent"
    assert [field.evaluate(name) for field in fields(visit.page)] == ["from", "to"]


@pytest.mark.nightly
@pytest.mark.parametrize("options", [SMALL_PHONE])
def test_times_fit_on_a_small_phone(visit: Visit) -> None:
    visit.open(f"{CHANNEL}?live=10s")
    visit.wait_for_chart(mode="live")
    visit.wait_for_answers()
    visit.page.get_by_test_id("times").click()
    fill(visit.page, "2026-01-31 12:00:00.123456789", "never")
    visit.page.get_by_test_id("time-error").get_by_text("is not a time").wait_for()
    page, window = visit.evaluate("() => [document.documentElement.scrollWidth, innerWidth]")
    assert window == 360
    assert page <= window
    outside = visit.evaluate("""() => [...document.querySelectorAll(".bar *, .times *")]
      .filter((part) => part.getBoundingClientRect().right > innerWidth)
      .map((part) => part.outerHTML)""")
    assert outside == []
