"""The detector on the node finds what eskin's own finds, event by event."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eskin import peaks
from sensor_node.firmware.peaks import PeakDetector, reaches

STEPS = st.integers(-4, 4).map(lambda step: step / 4)
WIDTHS = st.sampled_from([0.0, 0.0, 0.25, 0.5, 1.0, np.inf])
SIGNALS = st.lists(st.tuples(STEPS, WIDTHS), max_size=120)


def said(event: Any) -> tuple[Any, ...]:
    return (
        int(event.verdict),
        event.first,
        event.last,
        event.count,
        event.height,
        event.prominence,
    )


@given(SIGNALS, st.sampled_from([0.25, 0.5, 1.0]), st.integers(2, 60), st.data())
def test_same_events_in_any_pieces(
    signal: list[tuple[float, float]], prominence: float, longest: int, data: st.DataObject
) -> None:
    middle = np.cumsum([step for step, _ in signal])
    width = np.array([width for _, width in signal])
    lows, highs = (middle - width).tolist(), (middle + width).tolist()
    expected = peaks.PeakDetector(prominence, longest_region=longest)
    ours = PeakDetector(prominence, longest)
    start = 0
    while start < len(lows):
        end = start + data.draw(st.integers(1, len(lows)))
        piece = lows[start:end], highs[start:end]
        found = ours.feed(*piece, len(piece[0]))
        assert list(map(said, found)) == list(map(said, expected.feed(*piece)))
        if data.draw(st.booleans()):
            assert list(map(said, ours.gap(3))) == list(map(said, expected.gap(3)))
        start = end
    assert list(map(said, ours.gap(0))) == list(map(said, expected.finish()))


@given(st.floats(-1e300, 1e300), st.floats(-1e300, 1e300), st.floats(5e-324, 1e300))
def test_reaching_is_decided_exactly(high: float, low: float, prominence: float) -> None:
    exact = Fraction(high) - Fraction(low) >= Fraction(prominence)
    assert reaches(high, low, prominence) == exact
    # At the tie itself, which no random draw meets.
    tie = high - low
    if 0.0 < tie < np.inf:
        assert reaches(high, low, tie) == (Fraction(high) - Fraction(low) >= Fraction(tie))
