"""Instants keep their nanoseconds through RFC 3339 and back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.wire.timestamp import EARLIEST, LATEST, format_timestamp, parse_timestamp


@given(instant=st.integers(EARLIEST, LATEST))
def test_text_comes_back_to_the_nanosecond(instant: int) -> None:
    text = format_timestamp(instant)
    assert parse_timestamp(text) == instant
    assert len(text) == 30


@pytest.mark.parametrize(
    ("text", "instant"),
    [
        ("1970-01-01T00:00:00Z", 0),
        ("1970-01-01T00:00:00.5Z", 500_000_000),
        ("1970-01-01t01:00:00+01:00", 0),
        ("1969-12-31T23:59:59.999999999Z", -1),
        ("1769860800000000000", 1_769_860_800_000_000_000),
        ("-7", -7),
    ],
)
def test_reads_rfc_3339_and_integers(text: str, instant: int) -> None:
    assert parse_timestamp(text) == instant


@pytest.mark.parametrize(
    "text",
    [
        "",
        "now",
        "2026-13-01T00:00:00Z",
        "2026-01-01",
        "2026-01-01T00:00:00",
        "9" * 21,
        "1e9",
        "nan",
    ],
)
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"time|years|month"):
        parse_timestamp(text)
