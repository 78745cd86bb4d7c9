"""What the firmware writes by hand is what eskin's own contract writes."""

from __future__ import annotations

import cbor2
from eskin_sensor_node.firmware.cbor import Writer
from eskin_sensor_node.firmware.message_writer import MessageWriter
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.wire.messages import Kind, Outcome, Position, Result

TIME = (1_790_000_000_000_000_000, 1_790_000_000_000_004_000)


class Counter:
    """The third message is the one that is looked at."""

    def next_sequence(self) -> int:
        return 3


NAMES = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,30}", fullmatch=True)
SETTINGS = st.dictionaries(
    st.text("abcde_é", min_size=1, max_size=30),
    st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.text("abcé", min_size=1)),
    max_size=5,
)


@settings(deadline=None)
@given(
    st.dictionaries(NAMES, SETTINGS, max_size=10),
    st.integers(0, 2**53 - 1),
    st.none() | st.text("ab µ", min_size=1, max_size=200),
)
def test_result_has_the_bytes_of_the_contract(
    state: dict[str, dict[str, float | str]], command: int, reason: str | None
) -> None:
    outcome = Outcome.DONE if reason is None else Outcome.REFUSED
    stated = MessageWriter(7, Counter(), bytes(32)).result(
        TIME, command, int(outcome), reason, state
    )
    expected = Result(Position(7, 3), TIME, command, outcome, reason, state)
    assert stated.body == expected.encode()
    assert Result.decode(stated.body) == expected
    assert (stated.kind, stated.sequence, stated.earliest, stated.latest) == (Kind.RESULT, 3, *TIME)


ITEMS = st.one_of(
    st.integers(-(2**64), 2**64 - 1), st.floats(allow_nan=False), st.text(max_size=300)
)


@given(ITEMS)
def test_items_have_the_bytes_of_an_independent_encoder(item: float | str) -> None:
    out = Writer()
    if isinstance(item, str):
        out.text(item)
    elif isinstance(item, int):
        out.integer(item)
    else:
        out.real(item)
    assert bytes(out.buffer) == cbor2.dumps(item)


@given(st.one_of(st.integers(0, 300), st.sampled_from([65_535, 65_536])))
@settings(max_examples=30)
def test_heads_of_arrays_and_maps(n: int) -> None:
    for begin, value in (("array", [None] * n), ("map", dict.fromkeys(range(n)))):
        out = Writer()
        getattr(out, begin)(n)
        assert cbor2.dumps(value).startswith(bytes(out.buffer))
