"""The firmware reads what the cloud signs and what it wrote itself, and nothing else ends it."""

from __future__ import annotations

from typing import Any, Self

import cbor2
import pytest
from eskin_sensor_node.firmware.cbor import read_map
from eskin_sensor_node.firmware.commander import Commander, Refusal
from eskin_sensor_node.firmware.gap_reasons import ASLEEP, DEAD, RESET, TEXTS
from eskin_sensor_node.firmware.message_writer import MessageWriter
from hypothesis import given
from hypothesis import strategies as st

from eskin.wire.frames import Statements
from eskin.wire.messages import Command, CommandName, Kind, ResetCause

VALUES = st.recursive(
    st.integers(-(2**64), 2**64 - 1) | st.text("aé€", max_size=30) | st.floats(allow_nan=False),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("ab", max_size=3), inner),
    max_leaves=6,
)


class Counter:
    def next_sequence(self) -> int:
        return 3


class Nothing:
    """Neither outbox nor controls: nothing may be asked of it."""

    def __getattr__(self, name: str) -> Any:
        pytest.fail(f"{name} is asked for")


@given(st.dictionaries(st.integers(0, 2**64 - 1), VALUES, max_size=5))
def test_what_cbor2_writes_is_read(value: dict[int, Any]) -> None:
    written = cbor2.dumps(value)
    depth, left = 0, list(value.values())
    while left:
        depth += 1
        inner = [each for each in left if isinstance(each, dict | list)]
        left = [x for each in inner for x in (each.values() if isinstance(each, dict) else each)]
    if depth <= 4:
        assert read_map(written) == value


@given(
    st.binary(max_size=40)
    | st.binary(max_size=40).map(lambda data: bytes([0xA7, 1, Kind.COMMAND]) + data)
)
def test_bytes_that_are_no_command_are_refused_in_one_way(data: bytes) -> None:
    nothing: Any = Nothing()
    with pytest.raises(ValueError, match=r"."):
        Commander("palm", nothing, nothing).take(data, (0, 0))


def test_command_of_another_shape_is_none() -> None:
    nothing: Any = Nothing()
    fields = cbor2.loads(Command(1, "palm", 0, 9, CommandName.RESET, {}).encode())
    changed = [
        {1: int(Kind.FRAME)},
        {2: 0},
        {2: "1"},
        {3: 7},
        {5: 1.5},
        {6: 1},
        {7: [1]},
        {8: 1},
        {3: "sole"},
    ]
    for change in changed:
        with pytest.raises(ValueError, match=r"no command|it is for sole"):
            Commander("palm", nothing, nothing).take(cbor2.dumps(fields | change), (0, 0))
    with pytest.raises(ValueError, match="no command"):
        Commander("palm", nothing, nothing).take(
            cbor2.dumps({key: fields[key] for key in fields if key != 5}), (0, 0)
        )
    for data in (cbor2.dumps(fields) + b"\x00", cbor2.dumps(fields)[:-1], b"\xbf\xff", b"\x81\x01"):
        with pytest.raises(ValueError, match="no CBOR"):
            read_map(data)


def test_each_code_of_a_gap_has_its_reason() -> None:
    message_writer = MessageWriter(1, Counter(), bytes(32))

    def reason(code: int, taxel: str = "") -> str:
        body = message_writer.gap(code, (0, 1), 2, taxel=taxel).body
        return Statements.decode(body).gaps[0].reason

    stated = [reason(code) for code in range(len(TEXTS))]
    assert stated == list(TEXTS)
    assert len(set(TEXTS)) == len(TEXTS)
    for cause in ResetCause:
        assert TEXTS[RESET + cause] == f"{cause.label} reset"
    for why, code in ASLEEP.items():
        assert TEXTS[code] == f"deep sleep: {why}"
    assert reason(DEAD, "t05") == "t05 certainly dead"


def test_refusal_is_cut_to_the_size_of_a_result() -> None:
    class Box:
        """Controls that refuse, and an outbox that keeps the result."""

        def __init__(self, why: str) -> None:
            self.why = why
            self.message_writer = self
            self.stated: list[Any] = []

        def apply(self, *_: Any) -> Any:
            raise Refusal(self.why)

        def result(self, *stated: Any) -> Any:
            self.stated = list(stated)

        def batch(self) -> Self:
            return self

        def take(self, _: Any) -> None:
            pass

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *_: object) -> None:
            pass

    for why, stated in (("so", "so"), ("", "no reason given"), ("x" * 300, "x" * 200)):
        box: Any = Box(why)
        asked = Command(4, "palm", 0, 9, CommandName.RESET, {}).encode()
        assert Commander("palm", box, box).take(asked, (0, 8)) == (4, "reset", 1)
        assert box.stated == [(0, 8), 4, 1, stated, {}]
