"""Templates exclude each other, whatever their constants."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import pytest

from eskin.errors import GestureError
from eskin.gestures import Templates


@pytest.mark.parametrize(
    "change",
    [
        {"tap_ns": 0},
        {"tap_ns": 700_000_000},
        {"still_m": 0.016},
        {"still_m": 0.0095},
        {"slide_m": inf},
        {"swipe_m_per_s": nan},
        {"pause_ns": -1},
        {"scale": 1.0},
    ],
)
def test_constants_that_do_not_fit_are_rejected(change: dict[str, Any]) -> None:
    with pytest.raises(GestureError):
        Templates(**change)
