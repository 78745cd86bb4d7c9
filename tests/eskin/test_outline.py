"""No peer chooses what the CBOR decoder does."""

from __future__ import annotations

from typing import Any

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.messages.fields import load_any
from eskin.messages.outline import require_plain

TAG = cbor2.CBORTag
PLAIN = st.recursive(
    st.integers(-(2**64), 2**64 - 1) | st.floats() | st.text() | st.binary() | st.booleans(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)
HOSTILE = {
    "expression": TAG(35, "(?i:[a-\U0010ffff])" * 3000),
    "decimal": TAG(4, [10**18, 2**4000]),
    "rational": TAG(30, [1, TAG(4, [999_999_999, 1])]),
    "cycle": TAG(28, [TAG(29, 0)]),
    "set": TAG(258, [1, 1]),
    "deep": [[[[[[[[[[[[[[[[[0]]]]]]]]]]]]]]]]],
    "colliding keys": {k * (2**61 - 1): 0 for k in range(1001)},
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_items_are_refused_before_they_are_decoded(name: str) -> None:
    with pytest.raises(MessageError, match="no CBOR that may be read"):
        load_any(cbor2.dumps(HOSTILE[name]), "message")


@given(value=PLAIN)
def test_plain_items_pass_and_their_parts_do_not(value: Any) -> None:
    data = cbor2.dumps(value)
    require_plain(data, "message")
    for damaged in (data[:-1], data + b"\x00"):
        with pytest.raises(MessageError):
            require_plain(damaged, "message")


@pytest.mark.parametrize(
    "data", [b"", b"\x9f\xff", b"\x5f\x41a\xff", b"\x1c", b"\xff", b"\x9b" + b"\xff" * 8]
)
def test_indefinite_reserved_and_endless_lengths_are_refused(data: bytes) -> None:
    with pytest.raises(MessageError):
        require_plain(data, "message")


def test_what_is_wrong_is_told() -> None:
    with pytest.raises(MessageError, match="message is no CBOR that may be read: it holds a tag"):
        load_any(b"\xd8\x23a(", "message")
