"""Large skins, against scipy's components and matchings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from eskin.contacts import Skin, find_contacts

if TYPE_CHECKING:
    from numpy.typing import NDArray

THRESHOLD = 1000.0
ROWS, COLUMNS = 60, 140


@given(
    rows=st.integers(1, 30),
    columns=st.integers(1, 30),
    share=st.floats(0, 1),
    sure=st.floats(0, 1),
    seed=st.integers(0, 2**32 - 1),
)
def test_regions_and_cores_of_a_grid_are_scipys_components(
    rows: int, columns: int, share: float, sure: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    possible = random.random((rows, columns)) < share
    certain = possible & (random.random((rows, columns)) < sure)
    skin = Skin.grid(rows, columns, pitch=0.004, area=1e-5)
    found = find_contacts(
        np.where(certain, 1500.0, 0.0).ravel(),
        np.where(possible, 1600.0, 500.0).ravel(),
        skin,
        THRESHOLD,
    )
    for mask, labels in ((possible, found.region_of), (certain, found.core_of)):
        expected, _ = ndimage.label(mask)
        assert np.array_equal(labels.reshape(rows, columns), expected - 1)


def matrix_of(skin: Skin) -> sparse.csr_array:
    ones = np.ones(skin.neighbours.size, np.int8)
    return sparse.csr_array((ones, skin.neighbours, skin.starts), shape=(len(skin), len(skin)))


@given(count=st.integers(1, 60), degree=st.floats(0, 4), seed=st.integers(0, 2**32 - 1))
def test_regions_of_a_graph_are_scipys_components(count: int, degree: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    pairs = np.argwhere(np.triu(random.random((count, count)) < degree / count, 1))
    skin = Skin.from_edges(random.normal(size=(count, 3)), 1e-5, pairs)
    possible = random.random(count) < 0.7
    found = find_contacts(np.zeros(count), np.where(possible, 1600.0, 500.0), skin, THRESHOLD)
    inside = np.flatnonzero(possible)
    _, expected = csgraph.connected_components(matrix_of(skin)[inside][:, inside])
    found_of = found.region_of[inside].tolist()
    pairs_of = set(zip(found_of, expected.tolist(), strict=True))
    assert len(pairs_of) == len(found.regions) == len(set(expected.tolist()))
    assert np.all(found.region_of[~possible] == -1)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.8, 1.0])
@pytest.mark.parametrize("sure", [0.0, 0.005, 0.1])
def test_count_of_a_large_grid_is_that_of_scipys_matching(share: float, sure: float) -> None:
    random = np.random.default_rng(7)
    possible = random.random((ROWS, COLUMNS)) < share
    certain = possible & (random.random((ROWS, COLUMNS)) < sure)
    skin = Skin.grid(ROWS, COLUMNS, pitch=0.004, area=1e-5)
    found = find_contacts(
        np.where(certain, 1500.0, 0.0).ravel(),
        np.where(possible, 1600.0, 500.0).ravel(),
        skin,
        THRESHOLD,
    )
    beside = ndimage.binary_dilation(certain)
    free = np.flatnonzero(possible & ~beside)
    row, column = np.divmod(free, COLUMNS)
    black = (row + column) % 2 == 0
    between = matrix_of(skin)[free[black]][:, free[~black]]
    matched = csgraph.maximum_bipartite_matching(between, perm_type="column")
    expected = len(found) + free.size - np.count_nonzero(matched >= 0)
    assert found.total[1] == expected
    assert all(region.exact for region in found.regions)


def test_odd_rings_have_a_bound_that_need_not_be_reached() -> None:
    ring = [(0, 1), (1, 2), (0, 2)]
    skin = Skin.from_edges([(0, 0), (1, 0), (0, 1)], 1e-5, ring)
    (region,) = find_contacts([0.0] * 3, [2000.0] * 3, skin, THRESHOLD).regions
    assert region.count[0] == 0
    assert 1 <= region.count[1] <= 3
    assert not region.exact


def masks(found: NDArray[np.int64]) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(found == k).tolist()) for k in range(found.max() + 1)}


@given(seed=st.integers(0, 2**32 - 1))
def test_numbers_of_taxels_change_no_statement(seed: int) -> None:
    random = np.random.default_rng(seed)
    skin = Skin.grid(5, 6, pitch=0.004, area=random.uniform(1e-6, 9e-6, 30))
    lo = random.normal(700, 600, 30)
    hi = lo + random.uniform(0, 900, 30)
    new = random.permutation(30)  # new[k] is the new number of taxel k
    old = np.argsort(new)
    owners = np.repeat(np.arange(30), np.diff(skin.starts))
    edges = np.stack([owners, skin.neighbours], axis=1)
    edges = new[edges[edges[:, 0] < edges[:, 1]]]
    moved = Skin.from_edges(skin.positions[old], skin.area[old], edges)
    one = find_contacts(lo, hi, skin, THRESHOLD)
    two = find_contacts(lo[old], hi[old], moved, THRESHOLD)
    assert masks(two.core_of[new]) == masks(one.core_of)
    assert masks(two.region_of[new]) == masks(one.region_of)
    assert two.total == one.total
    assert sorted(each.cells for each in two) == sorted(each.cells for each in one)
