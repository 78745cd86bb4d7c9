"""Pictures of a skin against brute force over its samples, and how they are written."""

from __future__ import annotations

import itertools
import json
import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2
import numpy as np
import pyarrow as pa
import pytest
from eskin_cloud.query.pictures import Pictures, read_pictures
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eskin.errors import QueryError
from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.messages import Position
from tests.unit.cloud.clouds import emptied, problem, put
from tests.unit.cloud.messages import NODE, START, status
from tests.unit.cloud.skins import describe

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_cloud.store import Store

    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

PALM: Final = Patch(
    "palm", "pressure", "Pa", ("p0", "p1"), 2.0**-3, skew=(0, 3), threshold=1.0, cell_area=1e-6
)
TIP: Final = Patch("tip", "pressure", "Pa", ("t0",), 2.0**-3, threshold=0.25)
WARM: Final = Patch("warm", "temperature", "Cel", ("p0",), 2.0**-3)
HAND: Final = Layout(tuple(p.content_hash for p in (PALM, WARM, TIP)), (2, 1))
# The same taxels in other patches, and one less.
SWAPPED_PALM: Final = Patch("palm", "pressure", "Pa", ("p1", "t0"), 2.0**-3, threshold=1.0)
SWAPPED: Final = Layout((SWAPPED_PALM.content_hash,), (1,))
_BOUNDS: Final = st.sampled_from([-math.inf, -2.0, 0.0, 0.3, 1.0, 1.5, 3.0, math.inf])


class Sample(NamedTuple):
    """A sample of a channel, as brute force sees it."""

    t: int
    dt: int
    lo: float
    hi: float
    run: Position


def matrix(rows: int, pairs: Sequence[tuple[float, float]]) -> Interval:
    lo = [-math.inf if min(pair) == math.inf else min(pair) for pair in pairs]
    hi = [math.inf if max(pair) == -math.inf else max(pair) for pair in pairs]
    return Interval(np.reshape(lo, (rows, -1)), np.reshape(hi, (rows, -1)))


@st.composite
def frames(draw: st.DrawFn) -> list[Frame]:
    """Frames of both pages and layouts, with gaps and overlaps."""
    made = []
    for sequence in range(draw(st.integers(1, 8))):
        rows, period = draw(st.integers(1, 6)), draw(st.sampled_from([10, 10, 7]))
        layout, page, patches = draw(
            st.sampled_from(
                [
                    (HAND, 0, {0: PALM, 1: WARM}),
                    (HAND, 0, {0: PALM}),
                    (HAND, 1, {2: TIP}),
                    (SWAPPED, 0, {0: SWAPPED_PALM}),
                ]
            )
        )
        grid = Grid(draw(st.integers(0, 2)), period, draw(st.integers(0, 3)), rows, 0.99)
        packed = []
        for number, patch in patches.items():
            size = rows * len(patch.taxels)
            pairs = draw(st.lists(st.tuples(_BOUNDS, _BOUNDS), min_size=size, max_size=size))
            strides = draw(st.sampled_from([b"", b"\x00\x01"])) if len(patch.taxels) == 2 else b""
            packed.append(
                PatchSamples.pack(
                    matrix(rows, pairs), patch.least_width, patch=number, grid=0,
                    first_row=grid.first_row, strides=strides,
                )
            )  # fmt: skip
        first = START + draw(st.integers(0, 300))
        time = first, first + draw(st.integers(0, 3))
        position = Position(draw(st.integers(1, 2)), sequence)
        made.append(Frame(position, layout.content_hash, page, 0, time, (grid,), tuple(packed)))
    return made


windows = st.builds(
    lambda start, span: Window(START + start, START + start + span),
    st.integers(-30, 350),
    st.integers(1, 300),
)


def patches_of(frame: Frame) -> tuple[Patch, ...]:
    return (PALM, WARM, TIP) if frame.layout == HAND.content_hash else (SWAPPED_PALM,)


def samples_of(made: Sequence[Frame], channel: str) -> list[Sample]:
    """All samples of a channel in order of time."""
    found = []
    for frame in made:
        for record, values in zip(frame.patches, frame.values, strict=True):
            patch, grid = patches_of(frame)[record.patch], frame.grids[record.grid]
            if channel not in patch.channels:
                continue
            column = patch.channels.index(channel)
            step = 1 << record.strides[column] if record.strides else 1
            behind = sum(frame.time) // 2 + grid.delay + (patch.skew or (0, 0))[column]
            found += [
                Sample(
                    behind + row * grid.period,
                    grid.period * step,
                    float(values.inf[row, column]),
                    float(values.sup[row, column]),
                    frame.position,
                )
                for row in range(grid.rows)
                if (grid.first_row + row) % step == 0
            ]
    return sorted(found)


def is_in_gap(samples: Sequence[Sample], start: int, end: int) -> bool:
    """Whether no frame knows a channel at some time of a picture.

    A frame does from its first sample on until 1.5 periods after its last.
    """
    held: list[tuple[int, int]] = []
    for _, of_frame in itertools.groupby(sorted(samples, key=lambda s: s.run), lambda s: s.run):
        listed = list(of_frame)
        held.append((listed[0].t, listed[-1].t + listed[-1].dt * 3 // 2))
    at = start
    for begin, stop in sorted(held):
        if at < min(begin, end):
            return True
        at = max(at, stop)
    return at < end


@settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(made=frames(), window=windows, points=st.sampled_from([1, 4, 30]))
def test_pictures_are_hulls_of_samples(
    store: Store, made: list[Frame], window: Window, points: int
) -> None:
    emptied(store)
    describe(store, HAND, PALM, WARM, TIP, SWAPPED, SWAPPED_PALM)
    assert {each.result for each in put(store, *made).results} == {"stored"}
    with store.read() as connection:
        found = read_pictures(connection, NODE, window, points=points, quantity="pressure")
    assert 1 <= found.buckets.count <= points
    assert found.buckets.window.end >= window.end
    assert found.contact is not None
    thresholds = {
        channel: patch.threshold for patch in found.described.patches for channel in patch.channels
    }
    for number, taxel in enumerate(found.taxels):
        samples = samples_of(made, f"{taxel}.pressure")
        threshold = thresholds[f"{taxel}.pressure"]
        assert threshold is not None
        for k in range(found.buckets.count):
            start = found.buckets.start + k * found.buckets.width
            end = start + found.buckets.width
            mine = [each for each in samples if start <= each.t < end]
            assert found.lo[k, number] == min((each.lo for each in mine), default=-math.inf)
            assert found.hi[k, number] == max((each.hi for each in mine), default=math.inf)
            contact = found.contact[k, number]
            assert (contact == 2) == any(each.lo > threshold for each in mine)
            if any(each.hi > threshold for each in mine) or is_in_gap(samples, start, end):
                assert contact >= 1


def even(count: int = 20, *, missing: Sequence[int] = ()) -> list[Frame]:
    """Frames of a patch one after the other, 5 rows of 10 ms each; nothing is pressed."""
    made = []
    for sequence in range(count):
        if sequence in missing:
            continue
        grid = Grid(0, 10_000_000, 5 * sequence, 5, 1.0)
        values = Interval(np.full((5, 2), 0.25), np.full((5, 2), 0.5))
        packed = PatchSamples.pack(
            values, PALM.least_width, patch=0, grid=0, first_row=grid.first_row
        )
        first = START + 50_000_000 * sequence
        name = HAND.content_hash
        made.append(
            Frame(Position(1, sequence), name, 0, 0, (first, first + 10), (grid,), (packed,))
        )
    return made


def pictures(store: Store, made: Sequence[Frame], *, points: int = 10) -> Pictures:
    describe(store, HAND, PALM, WARM, TIP)
    put(store, *made)
    with store.read() as connection:
        window = Window(START + 10_000_000, START + 1_010_000_000)
        return read_pictures(connection, NODE, window, points=points)


def test_contact_is_impossible_where_all_samples_are_below(store: Store) -> None:
    found = pictures(store, even())
    assert found.contact is not None
    assert found.contact[:-1, :2].tolist() == [[0, 0]] * 9
    assert found.contact[:, 2].tolist() == [1] * 10, "the tip was never sampled"


def test_contact_is_possible_during_a_gap(store: Store) -> None:
    found = pictures(store, even(missing=[9]), points=5)  # 450 to 500 ms are missing
    assert found.contact is not None
    assert found.contact[:-1, 0].tolist() == [0, 0, 1, 0]
    assert found.contact[-1, 0] == 1, "nothing is known after the last sample"


def test_picture_lasts_long_enough_for_a_sample_of_each_channel(store: Store) -> None:
    found = pictures(store, even(), points=2000)
    assert found.buckets.width == 15_000_000
    assert np.isfinite(found.lo[:-1, :2]).all()


@pytest.mark.parametrize(
    ("patches", "expected"), [((WARM, PALM), "pressure"), ((WARM,), "temperature")]
)
def test_pressure_is_shown_where_no_quantity_is_asked_for(
    store: Store, patches: tuple[Patch, ...], expected: str
) -> None:
    of = Layout(tuple(patch.content_hash for patch in patches), (len(patches),))
    grid = Grid(0, 10, 0, 2, 0.99)
    values = {number: [(0.0, 1.0)] * 2 * len(each.taxels) for number, each in enumerate(patches)}
    packed = tuple(
        PatchSamples.pack(matrix(2, pairs), 2.0**-3, patch=number, grid=0, first_row=0)
        for number, pairs in values.items()
    )
    describe(store, of, *patches)
    first = START, START
    put(store, Frame(Position(1, 1), of.content_hash, 0, 0, first, (grid,), packed))
    with store.read() as connection:
        found = read_pictures(connection, NODE, Window(START, START + 20), points=1)
    assert found.quantity == expected


def test_quantity_that_no_patch_has_is_refused(store: Store) -> None:
    pictures(store, even())
    with store.read() as connection, pytest.raises(QueryError, match="pressure"):
        read_pictures(connection, NODE, Window(START, START + 1), points=1, quantity="force")


async def ask(stand: Stand, media: str, **params: Any) -> Any:
    describe(stand.cloud.store, HAND, PALM, WARM, TIP)
    put(stand.cloud.store, *even())
    params |= {"start": START, "end": START + 1_000_000_000, "points": 10}
    async with stand.client() as client:
        client.headers["Accept"] = media
        answer = await client.get(f"/api/v1/nodes/{NODE}/frames", params=params)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == media
    return answer.content


async def test_arrow_states_what_json_states(stand: Stand) -> None:
    body = json.loads(await ask(stand, "application/json"))
    table = pa.ipc.open_stream(await ask(stand, "application/vnd.apache.arrow.stream")).read_all()
    said = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    for name in ("node", "layout", "quantity", "unit"):
        assert said[name] == body[name]
    assert json.loads(said["taxels"]) == body["taxels"] == ["p0", "p1", "t0"]
    assert (int(said["dt"]), float(said["coverage"])) == (body["dt"], body["coverage"])
    assert body["t"] == [k * body["dt"] for k in range(10)]
    times = table["time"].cast(pa.int64()).to_pylist()
    assert times == [START + t for t in body["t"]]
    for side, unbounded in (("lo", -math.inf), ("hi", math.inf)):
        listed = [[unbounded if x is None else x for x in row] for row in body[side]]
        assert table[side].to_pylist() == listed
    assert table["contact"].to_pylist() == body["contact"]


async def test_sequence_of_frames_encloses_what_json_states(stand: Stand) -> None:
    body = json.loads(await ask(stand, "application/json"))
    data = await ask(stand, "application/cbor-seq")
    rows: dict[tuple[int, int], Any] = {}
    at = 0
    while at < len(data):
        size = len(cbor2.dumps(cbor2.loads(data[at:])))
        frame = Frame.decode(data[at : at + size])
        frame.require_layout(HAND, (PALM, WARM, TIP))
        (grid,) = frame.grids
        assert grid.period == body["dt"]
        for record, values in zip(frame.patches, frame.values, strict=True):
            for row in range(grid.rows):
                rows[grid.first_row + row, record.patch] = values[row]
        at += size
    assert set(rows) == {(k, patch) for k in range(10) for patch in (0, 2)}
    for (k, patch), values in rows.items():
        columns = slice(0, 2) if patch == 0 else slice(2, 3)
        for lo, hi, low, high in zip(
            values.inf, values.sup, body["lo"][k][columns], body["hi"][k][columns], strict=True
        ):
            assert (lo <= low) if low is not None else lo == -math.inf
            assert (hi >= high) if high is not None else hi == math.inf


async def test_layout_is_served_by_its_hash_for_ever(stand: Stand) -> None:
    describe(stand.cloud.store, HAND, PALM, WARM, TIP)
    put(stand.cloud.store, *even())
    latest = await stand.get(f"/api/v1/nodes/{NODE}/layout")
    named = await stand.get(f"/api/v1/nodes/{NODE}/layouts/{HAND.content_hash.hex()}")
    assert latest.json() == named.json()
    assert "immutable" in named.headers["cache-control"]
    assert "immutable" not in latest.headers["cache-control"]
    body = latest.json()
    assert body["layout"] == HAND.content_hash.hex()
    assert [each["patch"] for each in body["patches"]] == ["palm", "warm", "tip"]
    assert [each["page"] for each in body["patches"]] == [0, 0, 1]
    assert body["patches"][0]["threshold"] == 1.0


async def test_layout_that_the_node_did_not_state_is_not_found(stand: Stand) -> None:
    put(stand.cloud.store, status(0))
    problem(await stand.get(f"/api/v1/nodes/{NODE}/layout"), 404)
    describe(stand.cloud.store, SWAPPED, SWAPPED_PALM, node="other")
    problem(await stand.get(f"/api/v1/nodes/{NODE}/layouts/{SWAPPED.content_hash.hex()}"), 404)
    problem(await stand.get(f"/api/v1/nodes/{NODE}/frames"), 404)


async def test_channels_are_listed_by_quantity_and_text(stand: Stand) -> None:
    describe(stand.cloud.store, HAND, PALM, WARM, TIP)
    put(stand.cloud.store, *even())
    listed = await stand.get(f"/api/v1/nodes/{NODE}/channels")
    names = [item["id"] for item in listed.json()["items"]]
    assert names == ["p0.pressure", "p0.temperature", "p1.pressure", "t0.pressure"]
    first = listed.json()["items"][0]
    assert (first["patch"], first["dt"]) == ("palm", 10_000_000)
    warm = await stand.get(f"/api/v1/nodes/{NODE}/channels", quantity="temperature")
    assert [item["id"] for item in warm.json()["items"]] == ["p0.temperature"]
    palm = await stand.get(f"/api/v1/nodes/{NODE}/channels", text="P0.")
    assert [item["id"] for item in palm.json()["items"]] == ["p0.pressure", "p0.temperature"]
    node = await stand.get(f"/api/v1/nodes/{NODE}")
    assert node.json()["channels"] == 4
    assert node.json()["layout"] == HAND.content_hash.hex()
