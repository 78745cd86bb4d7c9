"""How many contacts a region has at most, compiled.

A contact without a core keeps clear of the cores: none of its taxels is in a core or beside one.
One taxel of each such contact makes an independent set of the free taxels, so that there are at
most as many as in the largest one; and the taxels of that one, each a contact by itself, are a true
set. For any matching M of a graph of n taxels an independent set has at most ``n - |M|`` taxels, as
it has at most one of each matched pair. In a bipartite graph the largest matching reaches that
(König 1931), and Hopcroft and Karp (1973) find it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import kernel, part

if TYPE_CHECKING:
    from eskin.contacts.components import Flags, Indices

_NONE: Final = -1
_LEFT: Final = 0
_RIGHT: Final = 1
_ODD: Final = 2


@kernel
def add_free_contacts(
    certain: Flags,
    region_of: Indices,
    starts: Indices,
    neighbours: Indices,
    most: Indices,
    exact: Flags,
) -> None:
    """Add the most contacts without a core to the cores of each region.

    Args:
        certain: Taxels of cores, (n,).
        region_of: Region of each taxel, -1 for others, (n,).
        starts: Adjacency lists, (n + 1,): see `Skin`.
        neighbours: Adjacency lists.
        most: Cores of each region; becomes its most contacts.
        exact: True for each region; becomes false where fewer contacts than ``most`` may be all.
    """
    free = _free_taxels(certain, region_of, starts, neighbours)
    side = np.full(free.size, _NONE, np.int64)
    mate = np.full(free.size, _NONE, np.int64)
    queue = np.empty(free.size, np.int64)
    for k in range(free.size):
        if not free[k] or side[k] != _NONE:
            continue
        size, bipartite = _colour(k, free, starts, neighbours, side, queue)
        pairs = _match_greedily(queue[:size], free, starts, neighbours, mate)
        most[region_of[k]] += size - pairs
        if not bipartite:
            exact[region_of[k]] = False
            for j in range(size):
                side[queue[j]] = _ODD
    layer = np.empty(free.size, np.int64)
    edge = np.empty(free.size, np.int64)
    while _layers(free, side, starts, neighbours, mate, layer, queue):
        edge[:] = starts[:-1]
        for k in range(free.size):
            if (
                side[k] == _LEFT
                and mate[k] == _NONE
                and _augment(k, free, starts, neighbours, mate, layer, edge, queue)
            ):
                most[region_of[k]] -= 1


@part
def _free_taxels(certain: Flags, region_of: Indices, starts: Indices, neighbours: Indices) -> Flags:
    free = np.empty(certain.size, np.bool_)
    for k in range(certain.size):
        free[k] = region_of[k] >= 0 and not certain[k]
        for edge in range(starts[k], starts[k + 1]):
            free[k] &= not certain[neighbours[edge]]
    return free


@part
def _colour(
    first: int, free: Flags, starts: Indices, neighbours: Indices, side: Indices, queue: Indices
) -> tuple[int, bool]:
    """Put the taxels of a component into the queue, neighbours on two sides; whether that works."""
    side[first] = _LEFT
    queue[0] = first
    size, at, bipartite = 1, 0, True
    while at < size:
        taxel = queue[at]
        at += 1
        for edge in range(starts[taxel], starts[taxel + 1]):
            other = neighbours[edge]
            if not free[other]:
                continue
            if side[other] == _NONE:
                side[other] = _RIGHT - side[taxel]
                queue[size] = other
                size += 1
            elif side[other] == side[taxel]:
                bipartite = False
    return size, bipartite


@part
def _match_greedily(
    taxels: Indices, free: Flags, starts: Indices, neighbours: Indices, mate: Indices
) -> int:
    pairs = 0
    for taxel in taxels:
        if mate[taxel] != _NONE:
            continue
        for edge in range(starts[taxel], starts[taxel + 1]):
            other = neighbours[edge]
            if free[other] and mate[other] == _NONE:
                mate[taxel], mate[other] = other, taxel
                pairs += 1
                break
    return pairs


@part
def _layers(
    free: Flags,
    side: Indices,
    starts: Indices,
    neighbours: Indices,
    mate: Indices,
    layer: Indices,
    queue: Indices,
) -> bool:
    """Number the left side by its distance from unmatched taxels; whether a matching can grow."""
    size = 0
    for k in range(free.size):
        layer[k] = _NONE
        if side[k] == _LEFT and mate[k] == _NONE:
            layer[k] = 0
            queue[size] = k
            size += 1
    at, grows = 0, False
    while at < size:
        taxel = queue[at]
        at += 1
        for edge in range(starts[taxel], starts[taxel + 1]):
            other = neighbours[edge]
            if not free[other]:
                continue
            following = mate[other]
            if following == _NONE:
                grows = True
            elif layer[following] == _NONE:
                layer[following] = layer[taxel] + 1
                queue[size] = following
                size += 1
    return grows


@part
def _augment(
    root: int,
    free: Flags,
    starts: Indices,
    neighbours: Indices,
    mate: Indices,
    layer: Indices,
    edge: Indices,
    path: Indices,
) -> bool:
    """Search a path of rising layers to an unmatched taxel, and swap its pairs.

    Layers rise along the path, so that no taxel is on it twice, whatever was swapped before.
    """
    path[0] = root
    depth = 0
    while depth >= 0:
        taxel = path[depth]
        if edge[taxel] == starts[taxel + 1]:
            depth -= 1
            continue
        other = neighbours[edge[taxel]]
        edge[taxel] += 1
        if not free[other]:
            continue
        following = mate[other]
        if following == _NONE:
            while depth >= 0:
                taxel = path[depth]
                mate[other], mate[taxel], other = taxel, other, mate[taxel]
                depth -= 1
            return True
        if layer[following] == layer[taxel] + 1:
            depth += 1
            path[depth] = following
    return False
