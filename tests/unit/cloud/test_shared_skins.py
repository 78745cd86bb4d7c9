"""Skins that several nodes share: what is stated encloses what is true, whatever the clocks are."""

from __future__ import annotations

import asyncio
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.query.contacts import ContactSkin
from eskin_cloud.query.pictures import read_pictures
from eskin_cloud.schemas.contacts import describe_contacts
from eskin_cloud.store.read.patch_runs import runs_of_frames
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from eskin.wire.frames import DescribedLayout
from eskin.wire.timestamp import parse_timestamp
from tests.support.examples import examples
from tests.unit.cloud.clouds import batch, emptied, put
from tests.unit.cloud.frame_clients import PATIENCE_S, Received, dial, serving
from tests.unit.cloud.messages import START
from tests.unit.cloud.shared_worlds import (
    AREA,
    MILLI,
    SPAN,
    THRESHOLD,
    World,
    components,
    make_world,
)
from tests.unit.cloud.skins import describe

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
SEEDS = st.integers(0, 2**32)
UNKNOWN = 5000.0, -5000.0
"""What may be true where no sample holds."""


def is_within(value: float, bounds: list[float | None] | tuple[float | None, float | None]) -> bool:
    lo, hi = bounds
    return (lo is None or lo <= value) and (hi is None or value <= hi)


def require_enclosed(world: World, document: dict[str, Any], true: list[float]) -> None:
    """Check what is stated of one instant against the true values."""
    number = {taxel: k for k, taxel in enumerate(world.taxels)}
    found = list(components({k for k, value in enumerate(true) if value > THRESHOLD}, world.edges))
    for core in document["cores"]:
        taxels = {number[taxel] for taxel in core["taxels"]}
        (contact,) = [each for each in found if taxels <= each]
        listed = sorted(contact)
        assert is_within(len(listed), core["cells"])
        assert is_within(len(listed) * AREA, core["area"])
        assert is_within(sum(true[k] * AREA for k in listed), core["force"])
        for axis, bounds in enumerate(core["centroid"]):
            # Equal areas: sums of few terms, whose rounding is far below a micrometre.
            lo, hi = bounds
            middle = float(np.mean(world.positions[listed, axis]))
            assert is_within(middle, (lo - 1e-9, hi + 1e-9))
    regions = [({number[taxel] for taxel in r["taxels"]}, r) for r in document["regions"]]
    inside = [sum(contact <= taxels for contact in found) for taxels, _ in regions]
    assert sum(inside) == len(found), "no contact is outside of the regions, or in two"
    for count, (_, region) in zip(inside, regions, strict=True):
        assert is_within(count, region["contacts"])


def truths(world: World, t: int) -> list[list[float]]:
    """Values of all taxels at an instant; what is unknown may be anything."""
    size = len(world.taxels)
    return [[world.value(k, t, unknown) for k in range(size)] for unknown in UNKNOWN]


@settings(max_examples=examples(60))
@given(seed=SEEDS)
def test_contacts_enclose_the_true_ones_at_any_instant(seed: int) -> None:
    world = make_world(seed)
    described = DescribedLayout.of(world.layout, world.patches)
    skin = ContactSkin.of(described)
    assert skin is not None
    runs = {
        number: [
            run
            for frame in frames
            for row in [{"boot": 1, "sequence": frame.position.sequence, "data": frame.encode()}]
            for _, run in runs_of_frames([row], described, [number])
        ]
        for number, frames in enumerate(world.frames.values())
    }
    random = np.random.default_rng(seed)
    narrow = 0
    for t in (START + random.integers(-20 * MILLI, SPAN + 20 * MILLI, 60)).tolist():
        pressures = skin.hold(described, runs, t, spread=True)
        document: Any = describe_contacts(list(world.frames), skin, pressures, skin.find(pressures))
        document = json.loads(json.dumps(document, default=float).replace("Infinity", "null"))
        narrow += int(np.count_nonzero(np.isfinite(pressures.hi)))
        for true in truths(world, t):
            assert np.all((pressures.lo <= true) & (np.array(true) <= pressures.hi))
            require_enclosed(world, document, true)
    assert narrow > 30, "not all is unknown"


def store_world(store: Store, world: World) -> None:
    for node, frames in world.frames.items():
        describe(store, world.layout, *world.patches, node=node)
        put(store, *frames, node=node)


@settings(max_examples=examples(30), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=SEEDS, points=st.sampled_from([3, 10, 60]))
@example(seed=1001, points=10)  # the last sample's end is uncertain by less than half a period
def test_pictures_enclose_the_true_samples(store: Store, seed: int, points: int) -> None:
    world = make_world(seed)
    emptied(store)
    store_world(store, world)
    with store.read() as connection:
        window = Window(START - 20 * MILLI, START + SPAN)
        node = list(world.frames)[seed % len(world.frames)]
        found = read_pictures(connection, node, window, points=points)
    assert list(found.taxels) == world.taxels
    assert found.contact is not None
    for taxel, samples in enumerate(world.samples):
        for k in range(found.buckets.count):
            start = found.buckets.start + k * found.buckets.width
            end = start + found.buckets.width
            mine = [sample.value for sample in samples if start <= sample.t < end]
            lo, hi = found.lo[k, taxel], found.hi[k, taxel]
            assert all(lo <= value <= hi for value in mine)
            contact = found.contact[k, taxel]
            if contact == 2:
                assert any(value > THRESHOLD for value in mine)
            if contact == 0:
                assert not any(value > THRESHOLD for value in mine)
                held = sum(min(s.until, end) - max(s.t, start) for s in samples
                           if s.t < end and s.until > start)  # fmt: skip
                assert held >= found.buckets.width, "all its time was sampled"


async def test_a_skin_is_read_from_any_of_its_nodes(stand: Stand) -> None:
    world = make_world(5)
    store_world(stand.cloud.store, world)
    random = np.random.default_rng(5)
    nodes = list(world.frames)
    for node in nodes:
        layout = (await stand.get(f"/api/v1/nodes/{node}/layout")).json()
        assert [each["node"] for each in layout["controllers"]] == nodes
        assert [each["node"] for each in layout["patches"]] == nodes
        own = (await stand.get(f"/api/v1/nodes/{node}/frames", own=True)).json()
        assert own["taxels"] == list(world.patches[nodes.index(node)].taxels)
        whole = (await stand.get(f"/api/v1/nodes/{node}/frames")).json()
        assert whole["taxels"] == world.taxels
        for t in (START + random.integers(0, SPAN, 10)).tolist():
            window = {"start": str(t), "end": str(t + 1), "points": 1}
            answer = await stand.get("/api/v1/contacts", node=node, **window)
            for document in answer.json()["items"]:
                assert document["nodes"] == nodes
                for true in truths(world, t):
                    require_enclosed(world, document, true)
    latest = (await stand.get("/api/v1/contacts", node=nodes[0], points=1)).json()["items"]
    assert len(latest) == 1


async def test_layout_of_which_no_node_is_known_is_drawn_as_unknown(stand: Stand) -> None:
    world = make_world(5)
    describe(stand.cloud.store, world.layout, *world.patches, node="other")
    frame = world.frames["n0"][0]
    put(stand.cloud.store, frame, node="other")
    whole = (await stand.get("/api/v1/nodes/other/frames", points=3)).json()
    assert whole["taxels"] == world.taxels
    assert {hi for row in whole["hi"] for hi in row} == {None}
    assert (await stand.get("/api/v1/contacts", node="other")).json()["items"] == []
    assert (await stand.get("/api/v1/nodes/other/frames", own=True)).status_code == 422


async def test_nodes_that_did_not_state_the_layout_are_unknown(stand: Stand) -> None:
    """A node cannot draw another node's samples into a skin by naming it."""
    world = make_world(5)
    silent, *others = world.frames
    for node in others:
        describe(stand.cloud.store, world.layout, *world.patches, node=node)
        put(stand.cloud.store, *world.frames[node], node=node)
    describe(stand.cloud.store, world.patches[0], node=silent)
    whole = (await stand.get(f"/api/v1/nodes/{others[0]}/frames", points=20)).json()
    unknown = len(world.patches[0].taxels)
    assert {hi for row in whole["hi"] for hi in row[:unknown]} == {None}
    assert any(hi is not None for row in whole["hi"] for hi in row[unknown:])
    assert all(each == 1 for row in whole["contact"] for each in row[:unknown])
    answer = await stand.get("/api/v1/contacts", node=others[0])
    assert answer.json()["items"]
    for document in answer.json()["items"]:
        pressed = {taxel for region in document["regions"] for taxel in region["taxels"]}
        assert pressed >= set(world.patches[0].taxels)
        for true in truths(world, parse_timestamp(document["t"])):
            true[:unknown] = [UNKNOWN[0]] * unknown
            require_enclosed(world, document, true)


def in_order(world: World) -> list[tuple[str, Frame]]:
    """All frames of a world, in order of time."""
    said = [(node, frame) for node, frames in world.frames.items() for frame in frames]
    return sorted(said, key=lambda each: (each[1].time[0], each[0]))


def last_instant(world: World) -> int:
    """The last multiple of the longest stretch that all nodes have certainly passed."""
    lasts = [frames[-1] for frames in world.frames.values()]
    stretch = max(frame.grids[0].rows * frame.grids[0].period for frame in lasts)
    passed = min(f.time[0] + (f.grids[0].rows - 1) * f.grids[0].period for f in lasts)
    return passed // stretch * stretch


@pytest.mark.parametrize("all_named", [False, True])
@pytest.mark.parametrize("seed", [5, 6, 7])
async def test_live_contacts_are_those_of_the_whole_skin(
    stand: Stand, seed: int, *, all_named: bool
) -> None:
    world = make_world(seed)
    nodes, got = list(world.frames), Received()
    steps = in_order(world)
    for node in nodes:
        describe(stand.cloud.store, world.layout, *world.patches, node=node)
    first = dict(reversed(steps))
    for node, frame in first.items():
        await stand.ingest(batch(frame, node=node))
    watched = nodes if all_named else nodes[-1:]
    async with serving(stand) as port, dial(port, stand.token, node=(nodes[-1],)) as connection:
        await connection.recv()
        if all_named:
            await connection.send(json.dumps({"nodes": nodes}))
        for node, frame in steps:
            if frame is first[node]:
                continue
            await stand.ingest(batch(frame, node=node))
            if node in watched[-1:]:
                await got.read(connection, frames=len(got.frames) + 1)
        async with asyncio.timeout(PATIENCE_S):
            while not got.contacts or parse_timestamp(got.contacts[-1]["t"]) < last_instant(world):
                got.take(await connection.recv())
    assert {node for node, _ in got.frames} == set(watched)
    times = [parse_timestamp(document["t"]) for document in got.contacts]
    stretch = max(f.grids[0].rows * f.grids[0].period for _, f in steps)
    assert times == sorted(set(times))
    heard = max(frames[1].time[0] for frames in world.frames.values()) + stretch
    assert all(t % stretch == 0 for t in times if t > heard), "once a stretch"
    for document, t in zip(got.contacts, times, strict=True):
        assert (document["node"], document["nodes"]) == (nodes[0], nodes)
        for true in truths(world, t):
            require_enclosed(world, document, true)
