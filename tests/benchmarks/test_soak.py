"""A short soak of the real stack: what was acknowledged is stored, each process is judged."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from benchmarks.soak import soak

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.timeout(900)
def test_soak_misses_nothing_and_judges_all(tmp_path: Path) -> None:
    found = soak(tmp_path, duration=2.0, rate=50.0, rest=0.0)
    assert found["sent"] > 0
    assert found["missing"] == 0
    assert set(found["processes"]) == {"broker", "gateway", "cloud"}
    for part in found["processes"].values():
        lo, hi = part["growth_an_hour"]
        assert lo <= hi
        assert 0 < part["idle"] <= part["most"]
