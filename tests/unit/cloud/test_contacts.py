"""Contacts of a watched skin, live and over time, against a search of our own."""

from __future__ import annotations

import asyncio
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.query.contacts import ContactSkin
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import Engine, event

from eskin.interval import Interval
from eskin.wire.frames import DescribedLayout, Frame, Grid, Layout, Patch, PatchSamples, Seam
from eskin.wire.messages import Position
from eskin.wire.timestamp import format_timestamp
from tests.unit.cloud.clouds import batch
from tests.unit.cloud.frame_clients import PATIENCE_S, Received, dial, serving
from tests.unit.cloud.messages import NODE, START
from tests.unit.cloud.skins import describe

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
THRESHOLD, AREA, PITCH_UM = 1000.0, 4e-6, 2000
PERIOD, STRETCH = 20_000_000, 100_000_000
GRID = Grid(delay=0, period=PERIOD, first_row=0, rows=5, coverage=1.0)
NO = (0.0, 64.0)
MAYBE = (900.0, 1100.0)
YES = (2000.0, 2064.0)
UNKNOWN = (-math.inf, math.inf)


def row_patch(number: int, **rest: Any) -> Patch:
    """A row of four taxels, at y = number."""
    positions = (tuple(range(0, 4 * PITCH_UM, PITCH_UM)), (number * PITCH_UM,) * 4)
    stated: dict[str, Any] = {
        "threshold": THRESHOLD,
        "cell_area": AREA,
        "positions": positions,
    } | rest
    return Patch(
        f"row{number}", "pressure", "Pa", tuple(f"t{number}{k}" for k in range(4)), 64.0,
        neighbours=((0, 1), (1, 2), (2, 3)), **stated,
    )  # fmt: skip


def grid_skin(rows: int = 3) -> tuple[Layout, tuple[Patch, ...]]:
    """Rows of four taxels, each beside the next; all on pages of their own."""
    patches = tuple(map(row_patch, range(rows)))
    beside = tuple((k, k) for k in range(4))
    seams = tuple(Seam(k, k + 1, beside) for k in range(rows - 1))
    return Layout(tuple(each.content_hash for each in patches), (1,) * rows, seams), patches


SKIN, ROWS = grid_skin()


def page(
    number: int, bounds: list[tuple[float, float]], *, stretch: int = 0, strides: bytes = b""
) -> Frame:
    """A frame of a page: the bounds in its last row, and other ones before."""
    lo, hi = (np.tile([side], (5, 1)) for side in zip(*bounds, strict=True))
    lo[:4], hi[:4] = NO if stretch % 2 else YES
    values = PatchSamples.pack(
        Interval(lo, hi), 64.0, patch=number, grid=0, first_row=0, strides=strides
    )
    first = START + stretch * STRETCH
    return Frame(Position(1, 3 * stretch + number), SKIN.content_hash, number,
                 stretch * STRETCH, (first, first + 2000), (GRID,), (values,))  # fmt: skip


def expected(bounds: list[list[tuple[float, float]]]) -> tuple[set[frozenset[str]], ...]:
    """The taxels of cores and of regions, by a flood of our own."""

    def flood(pressed: set[tuple[int, int]]) -> set[frozenset[str]]:
        found, left = set(), set(pressed)
        while left:
            part, fresh = set(), {left.pop()}
            while fresh:
                part |= fresh
                steps = {(y + a, x + b) for y, x in fresh
                         for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0))}  # fmt: skip
                fresh = steps & left
                left -= fresh
            found.add(frozenset(f"t{y}{x}" for y, x in part))
        return found

    cells = {(y, x): each for y, row in enumerate(bounds) for x, each in enumerate(row)}
    return tuple(
        flood({place for place, each in cells.items() if each[side] > THRESHOLD}) for side in (0, 1)
    )


def taxels(document: dict[str, Any]) -> tuple[set[frozenset[str]], ...]:
    return tuple(
        {frozenset(each["taxels"]) for each in document[part]} for part in ("cores", "regions")
    )


STATES = st.lists(
    st.lists(st.sampled_from((NO, MAYBE, YES)), min_size=4, max_size=4), min_size=3, max_size=3
)


@given(STATES)
def test_cores_and_regions_are_those_of_the_last_row(
    bounds: list[list[tuple[float, float]]],
) -> None:
    skin = ContactSkin.of(DescribedLayout.of(SKIN, ROWS))
    assert skin is not None
    pressures = skin.read_last([page(k, row).encode() for k, row in enumerate(bounds)])
    assert (pressures.t, pressures.error) == (START + 1000 + 4 * PERIOD, 1000)
    found = skin.find(pressures)
    cores, regions = expected(bounds)
    assert (len(found), len(found.regions)) == (len(cores), len(regions))


@given(STATES, st.lists(st.sampled_from((500.0, 1000.0, 1050.0, 3000.0)), min_size=3, max_size=3))
def test_each_taxel_has_its_own_threshold(
    bounds: list[list[tuple[float, float]]], thresholds: list[float]
) -> None:
    patches = [row_patch(k, threshold=each) for k, each in enumerate(thresholds)]
    layout = Layout(tuple(each.content_hash for each in patches), (1,) * 3, SKIN.seams)
    skin = ContactSkin.of(DescribedLayout.of(layout, patches))
    assert skin is not None
    found = skin.find(skin.read_last([page(k, row).encode() for k, row in enumerate(bounds)]))
    flat = [each for row in bounds for each in row]
    above = np.repeat(thresholds, 4)
    assert ((found.core_of >= 0) == (np.array([lo for lo, _ in flat]) > above)).all()
    # Encoded bounds may lie a quantum farther out.
    assert ((found.region_of >= 0) >= (np.array([hi for _, hi in flat]) > above)).all()
    for each in found:
        pressed = np.flatnonzero(found.core_of == each.core)
        assert each.force[0] <= sum(flat[k][0] for k in pressed) * AREA


def test_layout_without_thresholds_has_no_contacts() -> None:
    plain = [row_patch(k, threshold=None, cell_area=None) for k in range(2)]
    layout = Layout(tuple(each.content_hash for each in plain), (2,))
    assert ContactSkin.of(DescribedLayout.of(layout, plain)) is None


def test_column_that_is_sampled_seldom_counts_with_its_latest_sample() -> None:
    skin = ContactSkin.of(DescribedLayout.of(SKIN, ROWS))
    assert skin is not None
    often = page(0, [MAYBE] * 4, strides=bytes((0, 0, 0, 3)))  # the last column: in row 0 only
    pressures = skin.read_last([often.encode()])
    assert pressures.hi[:3].tolist() == [1100.0] * 3
    assert pressures.lo[3] == 2000.0
    assert np.isinf(pressures.hi[4:]).all()


async def send(stand: Stand, bounds: list[list[tuple[float, float]]], stretch: int) -> None:
    pages = [page(k, row, stretch=stretch) for k, row in enumerate(bounds)]
    await stand.ingest(batch(*pages))


async def until_contacts(got: Received, connection: Any, count: int = 1) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while len(got.contacts) < count:
            got.take(await connection.recv())


BOUNDS = [[YES, NO, NO, NO], [MAYBE, NO, MAYBE, NO], [NO, NO, NO, YES]]


async def test_viewers_of_a_node_are_sent_its_contacts(stand: Stand) -> None:
    describe(stand.cloud.store, SKIN, *ROWS)
    await send(stand, [[NO] * 4] * 3, 0)
    one, other = Received(), Received()
    async with (
        serving(stand) as port,
        dial(port, stand.token, node=(NODE,)) as first,
        dial(port, stand.token, node=(NODE,)) as second,
    ):
        await first.recv()
        await second.recv()
        await send(stand, BOUNDS, 1)
        await until_contacts(one, first)
        await until_contacts(other, second)
    assert one.contacts == other.contacts
    (document,) = one.contacts
    assert taxels(document) == expected(BOUNDS)
    assert (document["node"], document["unit"]) == (NODE, "Pa")
    assert document["threshold"] == THRESHOLD
    assert document["t"] == format_timestamp(START + STRETCH + 4 * PERIOD + 1000)
    (core,) = [each for each in document["cores"] if each["taxels"] == ["t00"]]
    assert core["cells"] == [1, 2]
    assert core["area"][0] <= AREA <= core["area"][1]
    lo, hi = core["centroid"][1]
    assert lo <= 0.0
    assert hi >= 0.001  # half a pitch: the taxel below may be pressed, too


async def test_page_that_is_missing_is_possibly_pressed(stand: Stand) -> None:
    describe(stand.cloud.store, SKIN, *ROWS)
    await send(stand, [[NO] * 4] * 3, 0)
    got = Received()
    async with serving(stand) as port, dial(port, stand.token, node=(NODE,)) as connection:
        await connection.recv()
        await stand.ingest(batch(page(0, BOUNDS[0], stretch=1), page(2, BOUNDS[2], stretch=1)))
        await stand.ingest(batch(page(0, BOUNDS[0], stretch=2)))
        await until_contacts(got, connection)
    of_missing = [BOUNDS[0], [UNKNOWN] * 4, BOUNDS[2]]
    assert taxels(got.contacts[0]) == expected(of_missing)
    assert any(each["force"][1] is None for each in got.contacts[0]["cores"])


async def test_contacts_are_found_only_while_a_node_is_watched(stand: Stand) -> None:
    describe(stand.cloud.store, SKIN, *ROWS)
    await send(stand, BOUNDS, 0)
    got = Received()
    async with serving(stand) as port, dial(port, stand.token) as connection:  # of all nodes
        await connection.recv()
        await send(stand, BOUNDS, 1)
        await got.read(connection, frames=3)
        assert not stand.cloud.contacts.latest
        await connection.send(f'{{"nodes": ["{NODE}"]}}')
        stretch = 2
        while not got.contacts:
            await send(stand, BOUNDS, stretch)
            await got.read(connection, frames=len(got.frames) + 1)
            stretch += 1


async def test_contacts_of_the_past_are_those_of_the_samples_that_hold(stand: Stand) -> None:
    describe(stand.cloud.store, SKIN, *ROWS)
    states = [[[NO] * 4] * 3, BOUNDS, [[YES] * 4] * 3]
    for number, bounds in enumerate(states):
        await send(stand, bounds, number)
    begin = START + 1000
    for number, bounds in enumerate(states):
        at = begin + number * STRETCH + 4 * PERIOD
        answer = await stand.get(
            "/api/v1/contacts", node=NODE, start=str(at), end=str(at + PERIOD), points=1
        )
        (document,) = answer.json()["items"]
        assert document["t"] == format_timestamp(at + PERIOD - 1)
        assert taxels(document) == expected(bounds)
    answer = await stand.get("/api/v1/contacts", node=NODE, points=100)
    assert answer.json()["next"] is None
    times = [each["t"] for each in answer.json()["items"]]
    assert times == sorted(times)
    assert times
    # Nothing is known a period after the last sample, nor before the first.
    late = begin + 3 * STRETCH + 2 * PERIOD
    for start in (late, begin - STRETCH):
        answer = await stand.get(
            "/api/v1/contacts", node=NODE, start=str(start), end=str(start + 1000)
        )
        assert answer.json() == {"items": [], "next": None}


async def test_an_instant_needs_as_few_statements_for_many_patches(stand: Stand) -> None:
    """On Citus each statement goes to another server."""
    describe(stand.cloud.store, SKIN, *ROWS)
    await send(stand, BOUNDS, 0)
    statements: list[str] = []

    def see(*given: Any) -> None:
        statements.append(given[2])

    at = START + 1000 + 4 * PERIOD
    event.listen(Engine, "before_cursor_execute", see)
    try:
        answer = await stand.get(
            "/api/v1/contacts", node=NODE, start=str(at), end=str(at + PERIOD), points=1
        )
    finally:
        event.remove(Engine, "before_cursor_execute", see)
    assert len(answer.json()["items"]) == 1
    assert sum("FROM patches" in each for each in statements) == 1


async def test_unknown_node_and_bad_window_are_refused(stand: Stand) -> None:
    assert (await stand.get("/api/v1/contacts", node="unheard")).status_code == 404
    assert (await stand.get("/api/v1/contacts")).status_code == 422
    describe(stand.cloud.store, SKIN, *ROWS)
    await send(stand, BOUNDS, 0)
    for bad in ({"points": 0}, {"points": 101}, {"start": "x"}):
        answer = await stand.get("/api/v1/contacts", **({"node": NODE} | bad))
        assert answer.status_code == 422
