"""Ranges of sequence numbers behave as the set of them, in as few ranges as possible."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.wire.sequence_set import SequenceRanges

SPANS = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 8)), max_size=30)


@given(spans=SPANS)
def test_behaves_as_a_set(spans: list[tuple[int, int]]) -> None:
    ranges, numbers = SequenceRanges(), set[int]()
    for first, more in spans:
        ranges.add(first, first + more)
        numbers |= set(range(first, first + more + 1))
    assert {n for n in range(80) if n in ranges} == numbers
    runs = sum(1 for n in numbers if n - 1 not in numbers)
    assert len(ranges) == runs
    assert list(SequenceRanges(ranges)) == list(ranges)


def test_reversed_range_is_refused() -> None:
    with pytest.raises(ValueError, match="reversed range: 2 > 1"):
        SequenceRanges().add(2, 1)
