"""Which taxels are certainly, which possibly pressed, and how they hang together; compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from eskin.kernels.jit import kernel, part

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats

    Indices: TypeAlias = "NDArray[np.int64]"
    Flags: TypeAlias = "NDArray[np.bool_]"


@kernel
def classify(lo: Floats, hi: Floats, threshold: float, certain: Flags, possible: Flags) -> None:
    """Mark the taxels above a threshold: NaN is a bound that says nothing."""
    for k in range(lo.size):
        certain[k] = lo[k] > threshold
        possible[k] = not hi[k] <= threshold


@kernel
def label_components(member: Flags, starts: Indices, neighbours: Indices, labels: Indices) -> int:
    """Number the connected components of some taxels, in order of their lowest taxel.

    Union-find with path halving (Tarjan and van Leeuwen 1984). A root is the lowest taxel of its
    tree, so that one ascending pass turns parents into numbers in place.

    Args:
        member: Which taxels, (n,).
        starts: Adjacency lists, (n + 1,): see `Skin`.
        neighbours: Adjacency lists.
        labels: Receives the component of each taxel, -1 for others, (n,).

    Returns:
        How many components there are.
    """
    for k in range(member.size):
        labels[k] = k
        if not member[k]:
            continue
        for edge in range(starts[k], starts[k + 1]):
            other = neighbours[edge]
            if other < k and member[other]:
                one, two = _root(labels, k), _root(labels, other)
                labels[max(one, two)] = min(one, two)
    count = 0
    for k in range(member.size):
        if not member[k]:
            labels[k] = -1
        elif labels[k] == k:
            labels[k] = count
            count += 1
        else:
            labels[k] = labels[labels[k]]
    return count


@part
def _root(parents: Indices, taxel: int) -> int:
    while parents[taxel] != taxel:
        parents[taxel] = parents[parents[taxel]]
        taxel = parents[taxel]
    return taxel


@part
def group(labels: Indices, order: Indices, count: int) -> tuple[Indices, Indices]:
    """Taxels by component, within each in a given order (counting sort).

    Args:
        labels: Component of each taxel, -1 for those that are left out.
        order: All taxels.
        count: How many components there are.

    Returns:
        Where each component starts, (count + 1,), and the taxels.
    """
    starts = np.zeros(count + 1, np.int64)
    for label in labels:
        if label >= 0:
            starts[label + 1] += 1
    for label in range(count):
        starts[label + 1] += starts[label]
    taxels = np.empty(starts[count], np.int64)
    places = starts.copy()
    for k in order:
        label = labels[k]
        if label >= 0:
            taxels[places[label]] = k
            places[label] += 1
    return starts, taxels
