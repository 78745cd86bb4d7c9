"""A tie is decided exactly; `unit.eskin.peaks.test_stream` compares events with the kernel's."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from eskin_sensor_node.firmware.peaks import reaches
from hypothesis import given
from hypothesis import strategies as st


@given(st.floats(-1e300, 1e300), st.floats(-1e300, 1e300), st.floats(5e-324, 1e300))
def test_reaching_is_decided_exactly(high: float, low: float, prominence: float) -> None:
    exact = Fraction(high) - Fraction(low) >= Fraction(prominence)
    assert reaches(high, low, prominence) == exact
    # At the tie itself, which no random draw meets.
    tie = high - low
    if 0.0 < tie < np.inf:
        assert reaches(high, low, tie) == (Fraction(high) - Fraction(low) >= Fraction(tie))
