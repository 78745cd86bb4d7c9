"""No peer chooses what the CBOR decoder does."""

from __future__ import annotations

import gc
from typing import Any, Final

import cbor2
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.wire.messages.cbor_map import load_any
from eskin.wire.messages.wellformed import require_plain

TAG = cbor2.CBORTag
PLAIN = st.recursive(
    st.integers(-(2**64), 2**64 - 1) | st.floats() | st.text() | st.binary() | st.booleans(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)
_ENDS: Final = (
    *(0x00, 0x7F, 0x80, 0x8F, 0x90, 0x9F, 0xA0, 0xBF, 0xC0, 0xC1, 0xC2, 0xDF, 0xE0, 0xE1, 0xEC),
    *(0xED, 0xEE, 0xEF, 0xF0, 0xF1, 0xF3, 0xF4, 0xF5, 0xFF),
)
"""First and last bytes of the ranges of UTF-8."""
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


@given(
    text=st.binary(max_size=6)
    | st.text(max_size=4).map(str.encode)
    | st.lists(st.sampled_from(_ENDS), max_size=4).map(bytes)
)
@example(text="a\x7f\x80\u07ff\u0800\ud7ff\ue000\uffff\U00010000\U0010ffff".encode())
@example(text=b"\xed\xa0\x80")  # half of a pair
@example(text=b"\xf4\x90\x80\x80")  # beyond the last character
@example(text=b"\xc1\xbf")  # longer than it must be
def test_texts_pass_where_they_are_utf8(text: bytes) -> None:
    data = cbor2.dumps([text])
    data = data[:1] + bytes([data[1] | 0x60]) + data[2:]  # a text, no bytes
    try:
        text.decode()
    except UnicodeDecodeError:
        with pytest.raises(MessageError, match="a text is no UTF-8"):
            require_plain(data, "message")
    else:
        require_plain(data, "message")


@pytest.mark.nightly
def test_hostile_texts_cost_no_memory() -> None:
    gc.collect()
    before = len(gc.get_objects())
    for _ in range(1000):
        with pytest.raises(MessageError):
            load_any(b"\x63\xff\xff\xff", "message")
    gc.collect()
    assert len(gc.get_objects()) < before + 500


def test_what_is_wrong_is_named() -> None:
    with pytest.raises(MessageError, match="message is no CBOR that may be read: it holds a tag"):
        load_any(b"\xd8\x23a(", "message")
