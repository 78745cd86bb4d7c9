"""Links, begins and ends hold in all worlds of a few instants, and each bound is reached."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise, product
from typing import TYPE_CHECKING

import numpy as np
import pytest

from eskin.contacts import ContactTracks, find_contacts, link_contacts, track_contacts
from eskin.interval import Verdict
from tests.unit.eskin.contacts.worlds import (
    THRESHOLD,
    Scene,
    adjacency,
    between,
    component_with,
    components,
    draw_graph,
    draw_grid,
    draw_pressures,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin.contacts import Skin

MOST_WORLDS = 3000
SEQUENCES = 250


def draw_sequence(
    random: np.random.Generator, draw: Callable[[np.random.Generator, int], Skin], instants: int
) -> list[Scene]:
    """Instants of a small skin that do not have too many worlds together."""
    while True:
        skin = draw(random, 6)
        scenes = [Scene(skin, *draw_pressures(random, (len(skin),))) for _ in range(instants)]
        worlds = math.prod(2 ** (scene.possible & ~scene.certain).bit_count() for scene in scenes)
        if worlds <= MOST_WORLDS:
            return scenes


def worlds_of(scenes: list[Scene]) -> Iterator[list[list[int]]]:
    """The contacts of each instant, in each world."""
    near = adjacency(scenes[0].skin)
    choices = [
        [components(world, near) for world in between(scene.certain, scene.possible)]
        for scene in scenes
    ]
    return (list(world) for world in product(*choices))


@pytest.mark.parametrize(("draw", "seed"), [(draw_grid, 3), (draw_graph, 4)])
def test_links_hold_in_all_worlds(
    draw: Callable[[np.random.Generator, int], Skin], seed: int
) -> None:
    random = np.random.default_rng(seed)
    seen: Counter[Verdict] = Counter()
    for _ in range(SEQUENCES):
        scenes = draw_sequence(random, draw, 2)
        near = adjacency(scenes[0].skin)
        cores = [components(scene.certain, near) for scene in scenes]
        shared: Counter[tuple[int, int]] = Counter()
        count = 0
        for world in worlds_of(scenes):
            count += 1
            one, two = (
                [component_with(core, parts) for core in own]
                for own, parts in zip(cores, world, strict=True)
            )
            for a, b in product(range(len(one)), range(len(two))):
                shared[a, b] += one[a] & two[b] != 0
        earlier, later = (
            find_contacts(scene.lo, scene.hi, scene.skin, THRESHOLD) for scene in scenes
        )
        links = link_contacts(earlier, later)
        for a, b in product(range(len(cores[0])), range(len(cores[1]))):
            expected = {0: Verdict.IMPOSSIBLE, count: Verdict.CERTAIN}.get(
                shared[a, b], Verdict.POSSIBLE
            )
            assert links.verdict(a, b) is expected
            seen[expected] += 1
    assert min(seen[verdict] for verdict in Verdict) > 10


def chain(world: list[list[int]], start: int, contact: int, step: int) -> list[list[int]]:
    """Contacts that a contact goes on in, instant by instant, forwards or backwards."""
    reached = [[contact]]
    at = start + step
    while 0 <= at < len(world):
        before = reached[-1]
        now = [part for part in world[at] if any(part & other for other in before)]
        if not now:
            break
        reached.append(now)
        at += step
    return reached


def times_of(instants: int) -> list[tuple[int, int]]:
    return [(100 * k, 100 * k + 30) for k in range(instants)]


def track(scenes: list[Scene]) -> ContactTracks:
    lo, hi = (np.array([getattr(scene, side) for scene in scenes]) for side in ("lo", "hi"))
    return track_contacts(lo, hi, times_of(len(scenes)), scenes[0].skin, THRESHOLD)


@pytest.mark.parametrize(
    ("draw", "seed"), [pytest.param(draw_grid, 5, marks=pytest.mark.nightly), (draw_graph, 6)]
)
def test_begin_and_end_hold_in_all_worlds(
    draw: Callable[[np.random.Generator, int], Skin], seed: int
) -> None:
    random = np.random.default_rng(seed)
    checked: Counter[object] = Counter()
    for _ in range(SEQUENCES):
        scenes = draw_sequence(random, draw, 4)
        check_sequence(scenes, track(scenes), checked)
    assert checked["worlds"] > 20_000
    assert checked["begins after"] > 20
    assert checked["ends before"] > 20
    assert min(checked[Verdict.POSSIBLE], checked[Verdict.CERTAIN]) > 20


def check_sequence(scenes: list[Scene], tracks: ContactTracks, checked: Counter[object]) -> None:
    """Compare the tracks with all worlds; counts what was compared."""
    near = adjacency(scenes[0].skin)
    cores = [components(scene.certain, near) for scene in scenes]
    held: dict[int, list[tuple[int, int]]] = {}
    for k, own in enumerate(cores):
        labels = tracks.cores["track"][tracks.cores["sample"] == k].tolist()
        assert len(labels) == len(set(labels)) == len(own)
        for label, core in zip(labels, own, strict=True):
            held.setdefault(label, []).append((k, core))
    assert [each.id for each in tracks] == sorted(held)
    begins: dict[int, set[int]] = {label: set() for label in held}
    ends: dict[int, set[int]] = {label: set() for label in held}
    goes_on: dict[int, list[set[bool]]] = {
        label: [set() for _ in chosen[1:]] for label, chosen in held.items()
    }
    for world in worlds_of(scenes):
        checked["worlds"] += 1
        for label, chosen in held.items():
            places = [(k, component_with(core, world[k])) for k, core in chosen]
            back, on = chain(world, *places[0], -1), chain(world, *places[-1], 1)
            begins[label].add(places[0][0] - len(back) + 1)
            ends[label].add(places[-1][0] + len(on) - 1)
            for number, ((k, one), (later, two)) in enumerate(pairwise(places)):
                reached = chain(world, k, one, 1)
                same = later - k < len(reached) and two in reached[later - k]
                goes_on[label][number].add(same)
    times = times_of(len(scenes))
    for each in tracks:
        assert (each.first, each.last) == (held[each.id][0][0], held[each.id][-1][0])
        first, last = min(begins[each.id]), max(ends[each.id])
        before = times[first - 1][0] if first else None
        after = times[last + 1][1] if last + 1 < len(times) else None
        assert each.begin == (before, times[max(begins[each.id])][1])
        assert each.end == (times[min(ends[each.id])][0], after)
        certain = all(outcome == {True} for outcome in goes_on[each.id])
        assert all(True in outcome for outcome in goes_on[each.id])
        assert each.verdict is (Verdict.CERTAIN if certain else Verdict.POSSIBLE)
        checked[each.verdict] += 1
        checked["begins after"] += first > 0
        checked["ends before"] += after is not None
    assert_instants(scenes, tracks, cores)


def assert_instants(scenes: list[Scene], tracks: ContactTracks, cores: list[list[int]]) -> None:
    near = adjacency(scenes[0].skin)
    for k, row in enumerate(tracks.instants):
        found = find_contacts(scenes[k].lo, scenes[k].hi, scenes[k].skin, THRESHOLD)
        regions = components(scenes[k].possible, near)
        coreless = sum(not any(core & region for core in cores[k]) for region in regions)
        assert row["sample"] == k
        assert (row["cores"], row["possible"]) == (len(cores[k]), coreless)
        assert (row["fewest"], row["most"]) == found.total
        assert row["exact"] == all(region.exact for region in found.regions)
