"""Statements about contacts that look right and are wrong."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest

from eskin.contacts import Skin, find_contacts
from eskin.errors import ContactError
from eskin.interval import Verdict

LOW, MAYBE, SURE = (0.0, 500.0), (500.0, 1500.0), (1500.0, 1600.0)
THRESHOLD = 1000.0


def row_of(*taxels: tuple[float, float]) -> tuple[Skin, np.ndarray, np.ndarray]:
    skin = Skin.grid(1, len(taxels), pitch=0.004, area=1e-5)
    lo, hi = np.array(taxels).T
    return skin, lo, hi


def test_least_area_is_that_of_one_core_and_not_of_all_certain_taxels_of_its_region() -> None:
    skin, lo, hi = row_of(SURE, SURE, SURE, MAYBE, SURE, SURE)
    found = find_contacts(lo, hi, skin, THRESHOLD)
    assert [each.cells for each in found] == [(3, 6), (2, 6)]
    assert found[0].area[0] <= 3e-5
    assert found[1].force[0] <= 2 * 1500.0 * 1e-5
    assert found.joined(0, 1) is Verdict.POSSIBLE
    assert found.regions[0].count == (1, 2)


def test_certain_taxel_is_not_the_only_contact_of_its_region() -> None:
    skin, lo, hi = row_of(SURE, MAYBE, MAYBE, MAYBE, MAYBE)
    (region,) = find_contacts(lo, hi, skin, THRESHOLD).regions
    assert region.cores == 1
    assert region.count == (1, 3)  # taxels 2 and 4 can be pressed alone
    assert region.exact


def test_taxels_beside_a_core_are_no_contacts_of_their_own() -> None:
    skin, lo, hi = row_of(MAYBE, SURE, MAYBE)
    assert find_contacts(lo, hi, skin, THRESHOLD).total == (1, 1)


@pytest.mark.parametrize("threshold", [0.0, -1.0, nan, inf])
def test_threshold_that_would_make_the_whole_skin_possible_is_rejected(threshold: float) -> None:
    skin, lo, hi = row_of(LOW, LOW, SURE)
    with pytest.raises(ContactError):
        find_contacts(lo, hi, skin, threshold)
    least = find_contacts(lo, hi, skin, 5e-324)
    assert least[0].cells == (1, 3)  # all of the skin: each upper bound is above


def test_pressure_equal_to_the_threshold_is_not_above_it() -> None:
    skin, lo, hi = row_of((1000.0, 1000.0), (1000.0, 1200.0), (1200.0, 1200.0))
    found = find_contacts(lo, hi, skin, 1000.0)
    assert found.core_of.tolist() == [-1, -1, 0]
    assert found.region_of.tolist() == [-1, 0, 0]


@pytest.mark.parametrize("unknown", [(nan, nan), (-inf, inf)])
def test_unknown_taxel_may_be_pressed_without_a_bound(unknown: tuple[float, float]) -> None:
    skin, lo, hi = row_of(SURE, unknown, LOW)
    (contact,) = find_contacts(lo, hi, skin, THRESHOLD)
    assert contact.cells == (1, 2)
    assert contact.force[0] <= 1500.0 * 1e-5 < 1.001 * contact.force[0]
    assert contact.force[1] == inf


def test_taxel_may_be_unknown_on_one_side() -> None:
    skin, lo, hi = row_of((1500.0, nan), LOW, (nan, 500.0))
    found = find_contacts(lo, hi, skin, THRESHOLD)
    assert [(each.cells, each.force[1]) for each in found] == [((1, 1), inf)]


def test_skin_of_which_nothing_is_known_has_no_certain_contact() -> None:
    skin = Skin.grid(4, 5, pitch=0.004, area=1e-5)
    found = find_contacts(np.full(20, nan), np.full(20, nan), skin, THRESHOLD)
    assert (len(found), found.total) == (0, (0, 10))
    assert [region.verdict for region in found.regions.possible] == [Verdict.POSSIBLE]
