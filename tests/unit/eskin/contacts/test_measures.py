"""Area, force and centroid enclose what exact arithmetic gives, at all magnitudes."""

from __future__ import annotations

from fractions import Fraction
from math import isfinite

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.contacts import Skin, find_contacts

SIZE = st.floats(1e-12, 1e3)
PLACE = st.floats(-1e3, 1e3)
PRESSURE = st.floats(1e-6, 1e9)
TAXELS = st.lists(
    st.tuples(SIZE, PLACE, PLACE, PRESSURE, st.floats(1, 2), st.booleans()), min_size=1, max_size=7
)


def complete(count: int) -> list[tuple[int, int]]:
    """All pairs: each set of taxels that holds one is connected."""
    return [(one, two) for one in range(count) for two in range(one)]


@given(taxels=TAXELS)
def test_bounds_are_the_extremes_of_exact_arithmetic(taxels: list[tuple[float, ...]]) -> None:
    area, x, y, pressure, factor, may_miss = map(np.array, zip(*taxels, strict=True))
    threshold = float(pressure.min()) / 4
    lo = np.where(may_miss, threshold / 2, pressure)
    hi = pressure * factor
    places = np.stack([x, y], axis=1)
    skin = Skin.from_edges(places, area, complete(len(area)))
    found = find_contacts(lo, hi, skin, threshold)
    sure = np.flatnonzero(may_miss == 0).tolist()
    assert len(found) == (1 if sure else 0)
    for contact in found:
        exact_area = [Fraction(float(each)) for each in area]
        low_force = sum(Fraction(float(lo[k])) * exact_area[k] for k in sure)
        high_force = sum(Fraction(float(p)) * a for p, a in zip(hi, exact_area, strict=True))
        assert_close(contact.force, low_force, high_force)
        assert_close(contact.area, sum(exact_area[k] for k in sure), sum(exact_area))
        for axis, bounds in enumerate(contact.centroid):
            means = centroids(exact_area, places[:, axis].tolist(), sure)
            assert bounds[0] <= min(means) <= max(means) <= bounds[1]
            slack = Fraction(float(np.abs(places[:, axis]).max()) * 1e-13)
            assert min(means) - Fraction(bounds[0]) <= slack
            assert Fraction(bounds[1]) - max(means) <= slack


def assert_close(
    bounds: tuple[float, float], least: Fraction | int, greatest: Fraction | int
) -> None:
    low, high = bounds
    assert low <= least <= Fraction(low) * (1 + Fraction(1, 10**14))
    assert Fraction(high) * (1 - Fraction(1, 10**14)) <= greatest <= high


def centroids(area: list[Fraction], places: list[float], sure: list[int]) -> list[Fraction]:
    """Centroids of all sets of taxels that hold those."""
    others = [k for k in range(len(area)) if k not in sure]
    found = []
    for chosen in range(2 ** len(others)):
        own = sure + [k for number, k in enumerate(others) if chosen >> number & 1]
        instant = sum((area[k] * Fraction(places[k]) for k in own), Fraction(0))
        found.append(instant / sum(area[k] for k in own))
    return found


@pytest.mark.parametrize("size", [1e-300, 1e300])
@pytest.mark.parametrize("place", [1e-300, 1e300])
def test_extreme_numbers_stay_enclosed(size: float, place: float) -> None:
    positions = np.array([[-place], [place], [place / 3]])
    skin = Skin.from_edges(positions, size, complete(3))
    (contact,) = find_contacts([2e300, 0.0, 2e-3], [3e300, 2e-3, 3e-3], skin, 1e-3)
    least, greatest = (Fraction(size) * Fraction(each) for each in (2e300, 3e300))
    assert contact.force[0] <= least
    assert contact.force[1] >= min(greatest, Fraction(np.finfo(float).max))
    assert contact.area[0] <= 2 * Fraction(size)
    assert not isfinite(contact.area[1]) or contact.area[1] >= 3 * Fraction(size)
    (low, high) = contact.centroid[0]
    assert low <= (Fraction(-place) + Fraction(place / 3)) / 2 <= high
    assert low <= (Fraction(place) + Fraction(place / 3) + Fraction(-place)) / 3 <= high


def test_known_contact_has_the_centroid_of_its_taxels() -> None:
    skin = Skin.grid(1, 4, pitch=0.5, area=1.0)
    (contact,) = find_contacts([9.0, 9.0, 9.0, 0.0], [9.0, 9.0, 9.0, 0.0], skin, 1.0)
    assert contact.centroid == ((0.5, 0.5), (0.0, 0.0))
    assert (contact.area, contact.force) == ((3.0, 3.0), (27.0, 27.0))
