"""Area, force and centroid of contacts, compiled; every bound is rounded outward.

Between its core c and its region r a contact may be any set S with ``c <= S <= r``. The greatest
centroid along an axis is that of c and the taxels of r above it: of a prefix, if r is sorted by
coordinate. A centroid can exceed M only where ``F(M) > 0`` for

    F(M) = sum over r of A·max(x - M, 0) - sum over c of A·max(M - x, 0),

so that any M with ``F(M) <= 0`` is a bound, and the zero of F is the least one. Dinkelbach's
iteration (1967) finds that zero in floats; F, rounded upward, then proves the bound.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.contacts.components import group
from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import add_up, lesser, mul_down, mul_up, sub_down, sub_up
from eskin.kernels.summation import running_sums_up, sum_up

if TYPE_CHECKING:
    from eskin.contacts.components import Indices
    from eskin.interval import Floats

_MOST_STEPS: Final = 60


@kernel
def add_up_components(
    labels: Indices,
    area: Floats,
    pressure: Floats,
    sign: float,
    cells: Indices,
    areas: Floats,
    forces: Floats,
) -> None:
    """Taxels, area and force of each component.

    Args:
        labels: Component of each taxel, -1 for others, (n,).
        area: Area of each taxel in m², (n,).
        pressure: Bound on each taxel's pressure in Pa, (n,); NaN where none is known.
        sign: 1 for upper, -1 for lower bounds.
        cells: Receives the number of taxels.
        areas: Receives a bound on the sum of areas, in m².
        forces: Receives a bound on the sum of pressure times area, in N.
    """
    count = cells.size
    starts, taxels = group(labels, np.arange(labels.size), count)
    row_of_areas = area[taxels]
    row_of_forces = np.empty(taxels.size)
    for k in range(taxels.size):
        bound = pressure[taxels[k]]
        bound = sign * math.inf if math.isnan(bound) else bound
        row_of_forces[k] = sign * mul_up(sign * bound, row_of_areas[k])
    for label in range(count):
        first, last = starts[label], starts[label + 1]
        cells[label] = last - first
        areas[label] = sign * sum_up(row_of_areas[first:last], sign)
        forces[label] = sign * sum_up(row_of_forces[first:last], sign)


@kernel
def bound_centroids(
    coordinates: Floats,
    order: Indices,
    area: Floats,
    region_of: Indices,
    core_of: Indices,
    region_of_core: Indices,
    sign: float,
    bounds: Floats,
) -> None:
    """Bounds on the centroid of each core's contact along one axis.

    Args:
        coordinates: Position of each taxel along the axis in m, (n,).
        order: Taxels by coordinate: falling for upper, rising for lower bounds.
        area: Area of each taxel in m², (n,).
        region_of: Region of each taxel, -1 for others, (n,).
        core_of: Core of each taxel, -1 for others, (n,).
        region_of_core: Region of each core.
        sign: 1 for upper, -1 for lower bounds.
        bounds: Receives a bound in m for each core.
    """
    regions = region_of.max() + 1
    starts, taxels = group(region_of, order, regions)
    core_starts, core_taxels = group(core_of, order, region_of_core.size)
    heights = np.empty(taxels.size)
    height = np.empty(coordinates.size)
    weights = area[taxels]
    instants = np.empty(taxels.size)
    wanted = np.zeros(regions, np.bool_)
    wanted[region_of_core] = True
    for region in range(regions):
        if not wanted[region]:
            continue
        first, last = starts[region], starts[region + 1]
        lowest = sign * coordinates[taxels[last - 1]]
        for k in range(first, last):
            above = sub_up(sign * coordinates[taxels[k]], lowest)
            height[taxels[k]] = heights[k] = above
            instants[k] = mul_up(area[taxels[k]], above)
        running_sums_up(weights[first:last], -1.0, weights[first:last])
        running_sums_up(instants[first:last], 1.0, instants[first:last])
    room = np.empty(core_taxels.size)
    for core in range(region_of_core.size):
        region = region_of_core[core]
        first, last = starts[region], starts[region + 1]
        own = core_taxels[core_starts[core] : core_starts[core + 1]]
        bound = _highest_centroid(
            heights[first:last],
            weights[first:last],
            instants[first:last],
            height[own],
            area[own],
            room[core_starts[core] : core_starts[core + 1]],
        )
        lowest = sign * coordinates[taxels[last - 1]]
        bounds[core] = sign * add_up(lowest, bound)


@part
def _highest_centroid(
    heights: Floats, weights: Floats, instants: Floats, own: Floats, areas: Floats, room: Floats
) -> float:
    """A bound on the centroid of all sets between a core and its region.

    Args:
        heights: Coordinates of the region above its lowest, falling, rounded up.
        weights: Area of the taxels up to each, rounded down.
        instants: Sum of area times height of the taxels up to each, rounded up.
        own: Heights of the core's taxels.
        areas: Their areas.
        room: Buffer as long as these.
    """
    bound = _mean(math.inf, heights, weights, instants, own, areas)
    for _ in range(_MOST_STEPS):
        higher = _mean(bound, heights, weights, instants, own, areas)
        if not higher > bound:
            break
        bound = higher
    step = 2.0**-52 * heights[0]
    for _ in range(_MOST_STEPS):
        if not _may_exceed(bound, heights, weights, instants, own, areas, room):
            return lesser(bound, heights[0])
        bound += step
        step *= 2.0
    return float(heights[0])


@part
def _mean(
    bound: float, heights: Floats, weights: Floats, instants: Floats, own: Floats, areas: Floats
) -> float:
    """The centroid of the core and all taxels above a bound, to nearest or so."""
    above = _count_above(bound, heights)
    instant = instants[above - 1] if above else 0.0
    weight = weights[above - 1] if above else 0.0
    for k in range(own.size):
        if own[k] <= bound:
            instant += areas[k] * own[k]
            weight += areas[k]
    return float(instant / weight)


@part
def _may_exceed(
    bound: float,
    heights: Floats,
    weights: Floats,
    instants: Floats,
    own: Floats,
    areas: Floats,
    room: Floats,
) -> bool:
    """Whether F(bound), rounded upward, is positive, or no number."""
    above = _count_above(bound, heights)
    gain = 0.0
    if above:
        gain = add_up(instants[above - 1], -mul_down(bound, weights[above - 1]))
    for k in range(own.size):
        below = sub_down(bound, own[k])
        room[k] = mul_down(areas[k], below) if below > 0.0 else 0.0
    return not gain <= -sum_up(room, -1.0)


@part
def _count_above(bound: float, heights: Floats) -> int:
    """How many of these, which fall, exceed a bound."""
    low, high = 0, heights.size
    while low < high:
        middle = (low + high) // 2
        if heights[middle] > bound:
            low = middle + 1
        else:
            high = middle
    return low
