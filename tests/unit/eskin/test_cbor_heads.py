"""Heads of CBOR items are the library's."""

from __future__ import annotations

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.wire.messages.cbor_map import ARRAY, BYTES, TEXT, opening


@given(st.integers(0, 70_000))
def test_head_of_strings_is_as_the_library_writes_it(length: int) -> None:
    assert opening(BYTES, length) + bytes(length) == cbor2.dumps(bytes(length))
    assert opening(TEXT, length) + b"x" * length == cbor2.dumps("x" * length)


@pytest.mark.parametrize("number", [0, 23, 24, 255, 256, 65_535, 65_536, 2**32 - 1, 2**32, 2**63])
def test_head_is_the_shortest(number: int) -> None:
    assert opening(ARRAY, number)[0] >> 5 == ARRAY
    # The head of a count differs from that of a number in its major type alone.
    assert opening(0, number) == cbor2.dumps(number)
