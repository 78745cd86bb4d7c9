"""Numbers of questions are enclosed by the floats beside them."""

from __future__ import annotations

import sys
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from eskin_cloud.query.parse_decimal import enclose_decimal
from hypothesis import given
from hypothesis import strategies as st


@given(
    st.one_of(
        st.floats(allow_nan=False).map(repr),
        st.decimals(allow_nan=False, allow_infinity=False).map(str),
        st.from_regex(r"[+-]?[0-9]{1,40}(\.[0-9]{0,20})?(e[+-]?[0-9]{1,2})?", fullmatch=True),
    )
)
def test_decimal_is_enclosed_by_neighbours(text: str) -> None:
    lo, hi = enclose_decimal(text)
    if "inf" in text:
        assert lo == hi == float(text)
        return
    if abs(Decimal(text).adjusted()) < 10_000:
        exact = Fraction(text)
        assert lo == -np.inf or Fraction(lo) <= exact
        assert hi == np.inf or exact <= Fraction(hi)
        assert lo == hi == exact or np.nextafter(lo, np.inf) == hi


@pytest.mark.parametrize(
    ("text", "lo", "hi"),
    [
        ("0.5", 0.5, 0.5),
        ("1e400", sys.float_info.max, np.inf),
        ("-1e99999999999999999999", -np.inf, -sys.float_info.max),
        ("1e-99999999999999999999", 0.0, 5e-324),
        ("-1e-400", -5e-324, 0.0),
        ("inf", np.inf, np.inf),
    ],
)
def test_number_beyond_floats_is_enclosed(text: str, lo: float, hi: float) -> None:
    assert enclose_decimal(text) == (lo, hi)


@pytest.mark.parametrize("text", ["", "nan", "-nan", "snan", "1_0", "0x1", "1e", "--1"])
def test_text_that_is_no_number_is_rejected(text: str) -> None:
    with pytest.raises(ValueError, match=r"number|float"):
        enclose_decimal(text)
