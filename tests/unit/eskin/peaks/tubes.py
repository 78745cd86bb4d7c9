"""Tubes that are hard on a search for peaks."""

from __future__ import annotations

from math import inf, nan, nextafter

from hypothesis import strategies as st

Sample = tuple[float, float]

_PLAIN = st.floats(-10.0, 10.0, width=16)
_TIED = st.integers(-3, 3).map(float)
_NEARLY_TIED = st.builds(lambda x, y: nextafter(x, y * inf), _TIED, st.sampled_from([-1.0, 1.0]))
_EXTREME = st.sampled_from(
    [0.0, -0.0, 5e-324, -5e-324, 2.0**-60, 1e308, -1e308, 1.7976931348623157e308]
)
_NUMBER = st.one_of(_PLAIN, _TIED, _NEARLY_TIED, _EXTREME)
MISSING: Sample = (nan, nan)


def _ordered(x: float, y: float) -> Sample:
    return (x, y) if x <= y else (y, x)


_SAMPLE = st.one_of(
    _NUMBER.map(lambda x: (x, x)),
    st.builds(_ordered, _NUMBER, _NUMBER),
    st.builds(_ordered, _TIED, _TIED),
    _NUMBER.map(lambda x: (-inf, x)),
    _NUMBER.map(lambda x: (x, inf)),
    st.just((-inf, inf)),
    st.just(MISSING),
)
_STRETCH = st.builds(lambda sample, n: [sample] * n, _SAMPLE, st.integers(1, 5))
ADVERSARIAL = st.lists(_STRETCH, max_size=40).map(lambda parts: sum(parts, list[Sample]()))
"""Ties, plateaus, neighbouring floats, overflow, unbounded sides, gaps, wide and thin by turns."""

PROMINENCES = st.one_of(
    st.sampled_from([1.0, 2.0, 0.5, 5e-324, 1.0 - 2.0**-53, 1e308]),
    st.floats(0.25, 6.0, width=16),
)
