"""The level that is typed where a skin states none: which taxels are above it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.support.processes import wait_until
from tests.unit.dashboard.browsing import history
from tests.unit.dashboard.pixels import samples_of

if TYPE_CHECKING:
    from tests.unit.dashboard.browsing import Visit
    from tests.unit.dashboard.replay import Replay

MS = 1_000_000
WINDOW = 40 * MS
"""So short that a picture of it holds a sample of each taxel, or two."""
APART = 0.04
"""Two samples differ by less than this share."""
TAXELS = ("t01", "t02", "t03")
PICO = 1e-12


def newest_samples(replay: Replay, end: int) -> dict[str, tuple[float, float]]:
    """The last sample of each taxel before an instant."""
    found = {}
    for taxel in TAXELS:
        place = f"/series/fingertip/{taxel}.capacitance"
        *_, (_, lo, hi) = samples_of(replay.get(place, start=end - WINDOW, end=end, points=100))
        found[taxel] = lo, hi
    return found


def pressed(samples: dict[str, tuple[float, float]], level: float) -> str:
    """How many are above a level, certainly and possibly."""
    certain = sum(lo > level for lo, _ in samples.values())
    possible = sum(hi > level for _, hi in samples.values())
    bounds = f"{certain}" if certain == possible else f"{certain}–{possible}"
    return f"{bounds} of {len(samples)} pressed"


@pytest.mark.nightly
@pytest.mark.parametrize("taxel", TAXELS)
def test_taxels_above_a_typed_level_are_counted(
    replay: Replay, visit: Visit, recorded: int, taxel: str
) -> None:
    samples = newest_samples(replay, recorded)
    visit.open(history("fingertip", recorded - WINDOW, recorded))
    field = visit.page.get_by_test_id("skin-level")
    total = visit.page.get_by_test_id("skin-total")
    wait_until(lambda: total.inner_text().endswith("pF"), "without a level, the hull is stated")
    assert visit.page.locator(".skin-level .unit").inner_text() == "pF"
    lo, hi = samples[taxel]
    for level in ((1 - APART) * lo, (lo + hi) / 2, (1 + APART) * hi):
        typed = float(f"{level / PICO:.6g}")
        field.fill(str(typed))
        expected = pressed(samples, typed * PICO)
        wait_until(lambda: total.inner_text() == expected, f"{expected} at {typed} pF")  # noqa: B023 -- waited for at once


def test_typed_level_that_is_no_number_changes_nothing(visit: Visit, recorded: int) -> None:
    visit.open(history("fingertip", recorded - WINDOW, recorded))
    field = visit.page.get_by_test_id("skin-level")
    total = visit.page.get_by_test_id("skin-total")
    wait_until(lambda: total.inner_text().endswith("pF"), "without a level, the hull is stated")
    hull = total.inner_text()
    field.fill("0.001")
    wait_until(lambda: total.inner_text() == "3 of 3 pressed", "all are above it")
    field.fill("much")
    assert field.get_attribute("aria-invalid") == "true"
    visit.wait_for_frame()
    assert total.inner_text() == "3 of 3 pressed"
    field.fill("")
    assert field.get_attribute("aria-invalid") == "false"
    wait_until(lambda: total.inner_text() == hull, "the hull is stated again")
