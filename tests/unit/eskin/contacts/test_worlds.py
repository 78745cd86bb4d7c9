"""What is said of one instant holds in all worlds, and each bound is reached in one."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from math import inf, isfinite
from typing import TYPE_CHECKING

import numpy as np
import pytest

from eskin.contacts import Contacts, Skin, find_contacts
from eskin.interval import Verdict
from tests.unit.eskin.contacts.worlds import (
    THRESHOLD,
    Scene,
    adjacency,
    between,
    bits,
    component_with,
    components,
    draw_graph,
    draw_grid,
    draw_pressures,
    exactly,
    numbers,
    total,
)

if TYPE_CHECKING:
    from collections.abc import Callable

SCENES = 350


def check_scene(scene: Scene, found: Contacts) -> Counter[str]:
    """Compare with all worlds of a scene; counts what was compared."""
    near = adjacency(scene.skin)
    cores = components(scene.certain, near)
    regions = components(scene.possible, near)
    assert [bits(np.flatnonzero(found.core_of == k).tolist()) for k in range(len(found))] == cores
    assert [
        bits(np.flatnonzero(found.region_of == k).tolist()) for k in range(len(found.regions))
    ] == regions
    seen: list[set[int]] = [set() for _ in cores]
    counts: list[set[int]] = [set() for _ in regions]
    joined: Counter[tuple[int, int]] = Counter()
    worlds = 0
    for world in between(scene.certain, scene.possible):
        worlds += 1
        parts = components(world, near)
        own = [component_with(core, parts) for core in cores]
        for k, contact in enumerate(own):
            seen[k].add(contact)
            for other in range(k):
                joined[other, k] += own[other] == contact
        for k, region in enumerate(regions):
            counts[k].add(sum(part & region != 0 for part in parts))
    check_counts(found, regions, counts, cores)
    for k, core in enumerate(cores):
        check_contact(scene, found, k, core, seen[k])
        for other in range(k):
            expected = Verdict.POSSIBLE if joined[other, k] else Verdict.IMPOSSIBLE
            assert joined[other, k] < worlds
            assert found.joined(other, k) is found.joined(k, other) is expected
        assert found.joined(k, k) is Verdict.CERTAIN
    exact = sum(region.exact for region in found.regions)
    return Counter(worlds=worlds, cores=len(cores), regions=len(regions), exact=exact)


def check_counts(
    found: Contacts, regions: list[int], counts: list[set[int]], cores: list[int]
) -> None:
    for region, mask, count in zip(found.regions, regions, counts, strict=True):
        inside = sum(core & mask != 0 for core in cores)
        assert region.cores == inside
        assert region.cells == mask.bit_count()
        assert region.verdict is (Verdict.CERTAIN if inside else Verdict.POSSIBLE)
        assert region.count[0] == min(count)
        assert region.count[1] >= max(count)
        assert not region.exact or region.count[1] == max(count)
    assert found.total[0] == sum(map(min, counts))
    assert found.total[1] >= sum(map(max, counts))
    coreless = sum(not any(core & mask for core in cores) for mask in regions)
    assert len(found.regions.possible) == coreless


def check_contact(scene: Scene, found: Contacts, number: int, core: int, seen: set[int]) -> None:
    contact = found[number]
    assert contact.core == number
    cells = [mask.bit_count() for mask in seen]
    assert contact.cells == (min(cells), max(cells))
    area = exactly(scene.skin.area)
    areas = [total(mask, area) for mask in seen]
    assert_tight(contact.area, min(areas), max(areas))
    region = component_with(core, components(scene.possible, adjacency(scene.skin)))
    # A pressed taxel has at least its lower bound, and more than the threshold.
    floor = exactly(np.fmax(scene.lo, THRESHOLD))
    least = total(core, floor, area)
    assert least == min(total(mask, floor, area) for mask in seen)
    unknown = any(np.isnan(scene.hi[k]) for k in numbers(region))
    greatest = inf if unknown else total(region, exactly(np.nan_to_num(scene.hi)), area)
    assert_tight(contact.force, least, greatest)
    for axis, (low, high) in enumerate(contact.centroid):
        place = exactly(scene.skin.positions[:, axis])
        means = [total(mask, area, place) / total(mask, area) for mask in between(core, region)]
        assert low <= min(means) <= max(means) <= high
        slack = Fraction(float(np.abs(scene.skin.positions).max()) * 1e-14)
        assert min(means) - Fraction(low) <= slack
        assert Fraction(high) - max(means) <= slack


def assert_tight(bounds: tuple[float, float], least: Fraction, greatest: Fraction | float) -> None:
    """Bounds enclose what is reached, and little more: each product and sum is rounded."""
    low, high = map(Fraction, bounds) if isfinite(bounds[1]) else (Fraction(bounds[0]), inf)
    slack = Fraction(1, 10**14)
    assert low <= least <= low * (1 + slack)
    assert high == greatest == inf or high * (1 - slack) <= greatest <= high


@pytest.mark.parametrize(("draw", "seed"), [(draw_grid, 1), (draw_graph, 2)])
def test_all_worlds(draw: Callable[[np.random.Generator], Skin], seed: int) -> None:
    random = np.random.default_rng(seed)
    checked: Counter[str] = Counter()
    for _ in range(SCENES):
        skin = draw(random)
        scene = Scene(skin, *draw_pressures(random, (len(skin),)))
        found = find_contacts(scene.lo, scene.hi, skin, THRESHOLD)
        checked += check_scene(scene, found)
    assert checked["worlds"] > 15_000
    assert checked["cores"] > 300
    if draw is draw_grid:
        assert checked["exact"] == checked["regions"] > 400
    else:
        assert 300 < checked["exact"] < checked["regions"]
