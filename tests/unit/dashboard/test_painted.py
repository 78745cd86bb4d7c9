"""What a chart's pixels say: live samples, answers and gaps, as the API answers."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from eskin.wire.timestamp import format_timestamp, parse_timestamp
from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import history, without_events
from tests.unit.dashboard.pixels import (
    BAND,
    CERTAIN,
    COVERED,
    FINE,
    MISSING,
    POSSIBLE,
    read_plots,
    samples_of,
)

if TYPE_CHECKING:
    from playwright.sync_api import Route

    from tests.support.demos import RunningDemo
    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.pixels import Plot
    from tests.unit.dashboard.replay import Replay

MS = 1_000_000
SECOND = 1000 * MS
GENTLE = "fingertip/t01.capacitance"
EDGE = 8
"""A sample's mark reaches fewer pixels to either side, also on a fine screen."""
UNTOLD = 100 * MS
"""The last bucket of a block reaches beyond its last sample by less."""
CERTAIN_LANE, POSSIBLE_LANE = -9, -1
"""Rows of a plot from below, at one pixel a CSS pixel."""


@pytest.mark.parametrize(
    ("options", "channel", "span"),
    [
        ({}, GENTLE, "10s"),
        pytest.param({}, "palm/t01.energy", "5s", marks=pytest.mark.nightly),
        pytest.param(FINE, "forearm/t01.distance", "5s", marks=pytest.mark.nightly),
    ],
)
def test_live_pixels_enclose_the_samples(
    demo: RunningDemo, live_visit: Visit, channel: str, span: str
) -> None:
    live_visit.page.route("**/api/v1/events*", without_events)
    live_visit.open(f"{channel}?live={span}")
    begin = int(live_visit.wait_for_chart(mode="live")["xMax"])
    wait_until(
        lambda: int(live_visit.chart()["xMax"]) > begin + 2 * SECOND,
        "the stream has followed the store",
    )

    def encloses() -> bool:
        plot, band = read_plots(live_visit, COVERED, BAND)
        assert plot.newest is not None
        series = demo.get(f"/series/{channel}", start=plot.start, end=plot.end, points=20_000)
        stated = range(plot.start, min(plot.newest - UNTOLD, plot.end))
        samples = [one for one in samples_of(series) if one[0] in stated]
        assert len(samples) >= 100
        # A gap may be hatched there: a node that is late states one before it goes on.
        assert not any(band.painted[plot.column(plot.newest) + EDGE :])
        area = "".join(plot.columns)
        assert area.count("1") < 0.95 * len(area), "a plot that is painted all over shows nothing"
        return all(plot.encloses(*sample) for sample in samples)

    for _ in range(3):
        # What a slow page has not been stated yet is blank until the store has stated it.
        wait_until(encloses, "each sample is painted over")
        live_visit.page.wait_for_timeout(700)


def test_certain_and_possible_answers_are_painted_in_lanes_of_their_own(
    replay: Replay, visit: Visit, recorded: int
) -> None:
    visit.page.route("**/api/v1/events*", without_events)
    window = history("palm/t01.energy", recorded - 3 * SECOND, recorded)
    visit.open(f"{window}&above=5e-12")
    visit.wait_for_chart(mode="history")
    visit.page.get_by_test_id("total-certain").wait_for()

    def lanes() -> tuple[Plot, Plot]:
        certain, possible = read_plots(visit, CERTAIN, POSSIBLE)
        return certain, possible

    wait_until(lambda: any(lane(lanes()[0], CERTAIN_LANE)), "the answer is painted")
    certain, possible = lanes()
    question = {"above": "5e-12", "start": certain.start, "end": certain.end}
    answer = replay.get("/series/palm/t01.energy/threshold", **question)
    assert answer["next"] is None
    for plot, row, verdict in (
        (certain, CERTAIN_LANE, "certain"),
        (possible, POSSIBLE_LANE, "possible"),
    ):
        stretches = stretches_of(answer, verdict)
        assert stretches
        painted = {column for column, is_painted in enumerate(lane(plot, row)) if is_painted}
        assert columns_of(plot, stretches, 0) <= painted <= columns_of(plot, stretches, 1)
    assert not any(lane(certain, POSSIBLE_LANE)), "no certain colour where possible is stated"
    assert not any(lane(possible, CERTAIN_LANE)), "no possible colour where certain is stated"


def stretches_of(answer: Any, verdict: str) -> list[tuple[int, int]]:
    """From when to when an answer has a verdict."""
    return [
        (parse_timestamp(item["start"]), parse_timestamp(item["end"]))
        for item in answer["items"]
        if item["verdict"] == verdict
    ]


def lane(plot: Plot, row: int) -> list[bool]:
    """Which columns are painted in a row."""
    return [column[row] == "1" for column in plot.columns]


def columns_of(plot: Plot, stretches: list[tuple[int, int]], slack: int) -> set[int]:
    """All columns of a plot that stretches of time touch, and so many more to either side."""
    found: set[int] = set()
    for start, end in stretches:
        found |= set(range(plot.column(start) - slack, plot.column(end) + 1 + slack))
    return found & set(range(len(plot.columns)))


@pytest.mark.parametrize(
    ("mode", "stated_by"), [("history", "samples"), ("history", "event"), ("live", "samples")]
)
def test_gap_is_painted_as_a_gap_and_never_as_band(
    replay: Replay, visit: Visit, mode: str, stated_by: str
) -> None:
    channels = {one["id"]: one for one in replay.get("/nodes/fingertip/channels")["items"]}
    last = parse_timestamp(channels["t01.capacitance"]["last"])
    gap = range(last - 3500 * MS, last - 1500 * MS)
    held: list[Route] = []
    visit.page.route("**/api/v1/events*", lambda route: answer_gap(route, gap, stated_by))
    visit.page.route("**/api/v1/series/**", lambda route: cut(route, gap, stated_by))
    # Nothing follows what the store knows.
    visit.page.route("**/api/v1/live?*", lambda route: held.append(route))  # noqa: PLW0108 -- Playwright marks what it is given
    place = f"{GENTLE}?live=30s" if mode == "live" else history(GENTLE, last - 5 * SECOND, last)
    visit.open(place)
    visit.wait_for_chart(mode=mode)

    def hatched() -> bool:
        (missing,) = read_plots(visit, MISSING)
        return missing.painted[missing.column((gap.start + gap.stop) // 2)]

    wait_until(hatched, "the gap is painted")
    band, missing = read_plots(visit, BAND, MISSING)
    first, after = band.column(gap.start), band.column(gap.stop)
    inside = range(first + EDGE, after - EDGE)
    assert len(inside) > 30
    assert [column for column in inside if band.painted[column]] == []
    assert [column for column in inside if not missing.painted[column]] == []
    around = {"start": max(band.start, gap.start - SECOND), "end": gap.stop + SECOND}
    series = replay.get(f"/series/{GENTLE}", points=20_000, **around)
    known = [sample for sample in samples_of(series) if not near(sample[0], gap)]
    assert len(known) > 100
    assert [sample for sample in known if not band.encloses(*sample)] == []
    clear = {band.column(instant) for instant, _, _ in known} - set(
        range(first - EDGE, after + EDGE)
    )
    assert [column for column in clear if missing.painted[column]] == []


def near(instant: int, gap: range) -> bool:
    """Whether an instant lies in a gap, or in a bucket that has to do with it."""
    return gap.start - UNTOLD <= instant < gap.stop + UNTOLD


def cut(route: Route, gap: range, stated_by: str) -> None:
    """Let the store know nothing of a stretch; a gap that an event states has no entries."""
    answer = route.fetch()
    series: dict[str, Any] = answer.json()
    start = parse_timestamp(series["t0"])
    rows = list(zip(series["t"], series["lo"], series["hi"], strict=True))
    lost = [start + t in gap for t, _, _ in rows]
    if stated_by == "event":
        rows = [row for row, is_lost in zip(rows, lost, strict=True) if not is_lost]
    else:
        rows = [
            (row[0], None, None) if is_lost else row
            for row, is_lost in zip(rows, lost, strict=True)
        ]
    t, lo, hi = zip(*rows, strict=True)
    route.fulfill(response=answer, json={**series, "t": t, "lo": lo, "hi": hi})


def answer_gap(route: Route, gap: range, stated_by: str) -> None:
    """Answer with the gap as an event, and with no other events."""
    event = {
        "id": "gap",
        "node": "fingertip",
        "channel": "t01.capacitance",
        "kind": "gap",
        "time": {"lo": format_timestamp(gap.start), "hi": format_timestamp(gap.stop)},
        "boot": 1,
        "sequence": 1,
        **dict.fromkeys(("verdict", "height", "prominence", "count", "unit", "coverage", "detail")),
    }
    asked = stated_by == "event" and "kind=gap" in route.request.url
    body = {"items": [event] if asked else [], "next": None}
    route.fulfill(body=json.dumps(body), content_type="application/json")
