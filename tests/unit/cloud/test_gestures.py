"""Gestures of a stored skin: no certain answer is wrong, whatever was lost and however sampled."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.query import gestures
from eskin_cloud.query.gestures import GestureSkin
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from eskin.contacts import Skin
from eskin.gestures import Gestures, find_gestures
from eskin.gestures.templates import TOUCH_KINDS
from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.messages import Position
from eskin.wire.timestamp import format_timestamp, parse_timestamp
from tests.support.examples import examples
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import emptied, problem, put
from tests.unit.cloud.messages import NODE, START
from tests.unit.cloud.shared_worlds import make_world
from tests.unit.cloud.skins import HAND, PATCHES, describe, frame
from tests.unit.cloud.stored_gestures import MILLI, PERIOD, draw_record, make_layout
from tests.unit.cloud.test_client import Way, connected
from tests.unit.eskin.gestures.worlds import THRESHOLD, check

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from eskin.gestures import Gesture
    from tests.unit.cloud.clouds import Stand
    from tests.unit.cloud.stored_gestures import Record

pytestmark = pytest.mark.anyio
SEEDS = st.integers(0, 2**32)
WHOLE = Window(START - 10**9, START + 10**10)


def keep(store: Store, record: Record) -> None:
    emptied(store)
    describe(store, record.layout, *record.patches)
    put(store, *record.frames)


def find(store: Store, window: Window = WHOLE) -> list[Gesture]:
    with store.read() as connection:
        return GestureSkin(connection, NODE).find(window)


@settings(max_examples=examples(120), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=SEEDS)
def test_no_certain_answer_is_wrong_and_no_gesture_is_missing(store: Store, seed: int) -> None:
    record = draw_record(np.random.default_rng(seed))
    assume(record.frames)
    keep(store, record)
    found = find(store)
    check(record.world, Gestures(found))
    if seed % 4 == 0:
        compact_all(store)
        assert find(store) == found


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=SEEDS, shift=st.integers(0, PERIOD))
def test_answers_do_not_depend_on_what_is_read_at_once(store: Store, seed: int, shift: int) -> None:
    record = draw_record(np.random.default_rng(seed))
    assume(record.frames)
    keep(store, record)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(gestures, "_FIRST_SPAN", 10**11)
        expected = find(store)
        patched.setattr(gestures, "_FIRST_SPAN", 10**9 + shift)
        patched.setattr(gestures, "_AT_ONCE", 1)
        assert find(store) == expected


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=SEEDS)
def test_answers_are_those_of_the_library_for_the_same_record(store: Store, seed: int) -> None:
    record = draw_record(np.random.default_rng(seed), whole=True)
    keep(store, record)
    times: dict[int, tuple[int, int]] = {}
    for each in record.frames:
        grid = each.grids[0]
        for row in range(grid.rows):
            low, high = (side + row * PERIOD for side in each.time)
            before = times.get(grid.first_row + row, (low, high))
            times[grid.first_row + row] = min(low, before[0]), max(high, before[1])
    instants = np.maximum.accumulate([times[k] for k in sorted(times)])
    skin = record.world.skin
    expected = find_gestures(*record.world.bounds, instants, skin, THRESHOLD)
    assert find(store) == list(expected)


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=SEEDS, at=st.integers(0, 16))
def test_window_is_where_the_record_begins_and_ends(store: Store, seed: int, at: int) -> None:
    record = draw_record(np.random.default_rng(seed), whole=True)
    keep(store, record)
    stated = {
        grid.first_row + row: (sum(each.time) + 1) // 2 + row * PERIOD
        for each in record.frames
        for grid in each.grids
        for row in range(grid.rows)
    }
    cut = START + PERIOD * at
    for window in (Window(WHOLE.start, cut), Window(cut, WHOLE.end)):
        inside = [row for row, t in stated.items() if window.start <= t < window.end]
        found = find(store, window)
        if not inside:
            assert found == []
            continue
        world, own = record.world, slice(min(inside), max(inside) + 1)
        parts = {name: getattr(world, name)[own] for name in ("certain", "possible", "times")}
        check(replace(world, begin=own.start, **parts), Gestures(found))


ACROSS = Skin.grid(3, 8, pitch=1.0, area=1.0)
"""Three rows of eight taxels, 7.5 mm apart."""


def skin_of(**rest: Any) -> tuple[Layout, list[Patch]]:
    return make_layout(ACROSS, [24], rest.get("skew", [0] * 24))


def say(
    layout: Layout, pressed: dict[int, set[int]], *, rows: int = 40, at_once: int = 5, **rest: Any
) -> list[Frame]:
    """Frames in which some taxels are pressed at some rows, 20 ms apart, known within 1 ms."""
    period = rest.get("period", 20 * MILLI)
    found = []
    for number, first in enumerate(range(0, rows, at_once)):
        true = np.array([[k in pressed.get(first + row, set()) for k in range(24)]
                         for row in range(at_once)])  # fmt: skip
        values = Interval(np.where(true, 1500.0, 0.0), np.where(true, 2000.0, 500.0))
        packed = PatchSamples.pack(
            values, 64.0, patch=0, grid=0, first_row=first, strides=rest.get("strides", b"")
        )
        stated = START + first * period
        found.append(
            Frame(Position(1, number), layout.content_hash, 0, first * period,
                  (stated, stated + MILLI), (Grid(0, period, first, at_once, 1.0),), (packed,))
        )  # fmt: skip
    return found


TAP = {k: {9, 10} for k in range(7, 10)}
SWIPE = {k: {8 + k - 20, 9 + k - 20} for k in range(20, 26)}


async def ask(stand: Stand, **params: Any) -> list[dict[str, Any]]:
    answer = await stand.get(f"/api/v1/nodes/{NODE}/gestures", **params)
    assert answer.status_code == 200, answer.text
    document = answer.json()
    assert document["next"] is None
    items: list[dict[str, Any]] = document["items"]
    return items


@pytest.mark.parametrize("late", [0, 12])
async def test_taps_and_swipes_are_certain(stand: Stand, late: int) -> None:
    skew = [late * MILLI * (k % 2) for k in range(24)]
    layout, patches = skin_of(skew=skew)
    describe(stand.cloud.store, layout, *patches)
    put(stand.cloud.store, *say(layout, TAP | SWIPE))
    tap, swipe = await ask(stand)
    assert [(each["kind"], each["verdict"]) for each in (tap, swipe)] == [
        ("tap", "certain"), ("swipe", "certain"),
    ]  # fmt: skip
    for each, first, last in ((tap, 7, 9), (swipe, 20, 25)):
        for side, row in (("begin", first), ("end", last)):
            lo, hi = (START + row * 20 * MILLI + more * MILLI for more in (0, 1 + late))
            assert each[side] == {"lo": format_timestamp(lo), "hi": format_timestamp(hi)}
    assert tap["direction"] is None
    # Two taxels are pressed: the touch is between them.
    x = [place * 1e-6 for place in patches[0].positions[0]]
    for each, first, last in ((tap, 9, 9), (swipe, 8, 13)):
        (place,) = each["places"]
        for side, taxel in (("begin", first), ("end", last)):
            lo, hi = place[side][0]
            assert lo <= (x[taxel] + x[taxel + 1]) / 2.0 <= hi < lo + 1e-3
    assert swipe["direction"]["lo"] <= 0.0 <= swipe["direction"]["hi"] < 0.1
    assert await ask(stand, kind="swipe") == [swipe]
    assert await ask(stand, kind="hold") == []
    assert await ask(stand, verdict="certain") == [tap, swipe]
    assert await ask(stand, verdict="possible") == []
    assert await ask(stand, start=str(START + 300 * MILLI)) == [swipe | {"contacts": [0]}]


async def test_lost_frame_makes_what_it_may_have_held_possible(stand: Stand) -> None:
    layout, patches = skin_of()
    describe(stand.cloud.store, layout, *patches)
    frames = say(layout, TAP | SWIPE)
    put(stand.cloud.store, *(each for each in frames if each.position.sequence != 2))
    items = await ask(stand)
    assert [each["kind"] for each in items if each["verdict"] == "certain"] == ["swipe"]
    lost = START + 9 * 20 * MILLI, START + 15 * 20 * MILLI + MILLI
    (tap,) = (each for each in items if each["kind"] == "tap" and each["contacts"])
    assert parse_timestamp(tap["end"]["lo"]) == START + 9 * 20 * MILLI
    assert parse_timestamp(tap["end"]["hi"]) == lost[1]
    strays = [each for each in items if not each["contacts"]]
    assert {each["kind"] for each in strays} >= {"tap"}
    for each in strays:
        assert lost[0] <= parse_timestamp(each["begin"]["lo"])
        assert parse_timestamp(each["end"]["hi"]) <= lost[1]


async def test_touch_may_lie_within_a_gap_though_all_is_pressed_around_it(stand: Stand) -> None:
    layout, patches = skin_of()
    describe(stand.cloud.store, layout, *patches)
    frames = say(layout, {k: set(range(24)) for k in range(40)})
    put(stand.cloud.store, *(each for each in frames if each.position.sequence != 2))
    items = [each for each in await ask(stand) if not each["contacts"]]
    strays = [each for each in items if each["kind"] in TOUCH_KINDS]
    assert "tap" in {each["kind"] for each in strays}
    for each in strays:
        assert parse_timestamp(each["begin"]["lo"]) == START + 9 * 20 * MILLI
        assert parse_timestamp(each["end"]["hi"]) == START + 15 * 20 * MILLI + MILLI


async def test_row_at_which_nothing_is_sampled_is_no_instant(stand: Stand) -> None:
    layout, patches = skin_of()
    describe(stand.cloud.store, layout, *patches)
    put(stand.cloud.store, *say(layout, TAP, strides=bytes([1] * 24)))
    (tap,) = await ask(stand)
    assert (tap["kind"], tap["verdict"]) == ("tap", "certain")
    assert tap["begin"] == tap["end"]
    assert tap["begin"]["lo"] == format_timestamp(START + 8 * 20 * MILLI)


async def test_taxel_is_unknown_where_it_is_not_sampled(stand: Stand) -> None:
    layout, patches = skin_of()
    describe(stand.cloud.store, layout, *patches)
    put(stand.cloud.store, *say(layout, TAP | SWIPE, strides=bytes(k == 23 for k in range(24))))
    items = await ask(stand)
    # Far from it, all is known.
    assert [each["kind"] for each in items if each["verdict"] == "certain"] == ["tap", "swipe"]
    begins = [parse_timestamp(each["begin"]["lo"]) for each in items if not each["contacts"]]
    assert set(begins) >= {START + row * 20 * MILLI for row in range(1, 39, 2)}


async def test_client_asks_for_gestures(stand: Stand) -> None:
    layout, patches = skin_of()
    describe(stand.cloud.store, layout, *patches)
    put(stand.cloud.store, *say(layout, TAP | SWIPE))

    def client_asks() -> list[list[dict[str, Any]]]:
        with connected(stand, Way(stand)) as client:
            return [
                client.gestures(NODE),
                client.gestures(NODE, kind="tap"),
                client.gestures(NODE, verdict="possible"),
                client.gestures(NODE, start=START + 300 * MILLI, end=START + 10**9),
            ]

    every, taps, possible, later = await asyncio.to_thread(client_asks)
    assert [each["kind"] for each in every] == ["tap", "swipe"]
    assert taps == every[:1]
    assert possible == []
    assert [each["kind"] for each in later] == ["swipe"]


async def test_what_cannot_be_answered_is_refused(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def refused(node: str = NODE, status: int = 422, **params: Any) -> str:
        return problem(await stand.get(f"/api/v1/nodes/{node}/gestures", **params), status)

    assert "unheard" in await refused("unheard", 404)
    world = make_world(5)
    shared = list(world.frames)
    for node, frames in world.frames.items():
        describe(stand.cloud.store, world.layout, *world.patches, node=node)
        put(stand.cloud.store, *frames, node=node)
    said = await refused(shared[0])
    assert "shares its skin" in said
    assert "docs/gestures.md" in said
    describe(stand.cloud.store, HAND, *PATCHES, node="bare")
    put(stand.cloud.store, frame(0), node="bare")
    assert "no patch in Pa" in await refused("bare", 404)
    layout, patches = skin_of()
    describe(stand.cloud.store, layout, *patches)
    put(stand.cloud.store, *say(layout, TAP))
    assert await ask(stand)
    monkeypatch.setattr(gestures, "MOST_INSTANTS", 39)
    assert "over 39 instants" in await refused()
    assert await ask(stand, start=str(START + 30 * MILLI)) != []
    monkeypatch.setattr(gestures, "MOST_SAMPLES", 24 * 20)
    assert "over 20 instants" in await refused(start=str(START + 30 * MILLI))
    for bad in ({"kind": "wave"}, {"verdict": "impossible"}, {"start": "x"}, {"points": 3}):
        await refused(**bad)


@pytest.mark.parametrize("period", [10 * MILLI, 15 * MILLI])
async def test_patches_of_several_grids_are_refused(stand: Stand, period: int) -> None:
    layout, patches = make_layout(ACROSS, [16, 8], [0] * 24)
    describe(stand.cloud.store, layout, *patches)
    frames = []
    for page, (size, own) in enumerate(((16, 20 * MILLI), (8, period))):
        values = Interval(np.zeros((6, size)), np.full((6, size), 500.0))
        packed = PatchSamples.pack(values, 64.0, patch=page, grid=0, first_row=0)
        grid = Grid(0, own, 0, 6, 1.0)
        frames.append(
            Frame(
                Position(1, page), layout.content_hash, page, 0, (START, START), (grid,), (packed,)
            )
        )
    put(stand.cloud.store, frames[0])
    assert await ask(stand) != []  # of the other page nothing is known
    put(stand.cloud.store, frames[1])
    answer = await stand.get(f"/api/v1/nodes/{NODE}/gestures")
    assert "different instants" in problem(answer, 422)
