"""Messages come back as they went; what is no message is refused with its place and value."""

from __future__ import annotations

from pathlib import Path

import cbor2
import pycddl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.interval import Verdict
from eskin.wire.messages import (
    Acknowledgement,
    Energy,
    Message,
    Position,
    ResetCause,
    Shedding,
    Status,
    TaxelFaults,
    decode_message,
)
from eskin.wire.messages.cbor_map import dump

EXAMPLES: list[Message] = [
    Status(Position(3, 6), (1, 2), "fingertip", "three taxels", 10**9, 1, 2, 3, 4),
    Status(Position(3, 7), (1, 2), "palm", "a palm", 10**9, 1, 2, 3, 4, ResetCause.WATCHDOG),
    Status(
        Position(3, 8), (1, 2), "palm", "a palm", 10**9, 1, 2, 3, 4,
        faults=(TaxelFaults("t01", Verdict.CERTAIN, Verdict.POSSIBLE),),
    ),
    Status(Position(3, 9), (1, 2), "palm", "a palm", 10**9, 1, 2, 3, 4, faults=()),
    Status(Position(3, 8), (1, 2), "hand", "a hand", 10**9, 1, 2, 3, 4, gateway_time=-5),
    Status(
        Position(3, 9), (1, 2), "hand", "a hand", 10**9, 1, 2, 3, 4,
        energy=Energy((0.5, 1.0), (0.25, 0.5), Verdict.POSSIBLE, Shedding.PEAKS),
        held=Position(2, 7), ended=((1, 8), (2, 9)),
    ),
]  # fmt: skip


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda m: type(m).__name__)
def test_message_comes_back_equal(message: Message) -> None:
    assert decode_message(message.encode()) == message


@pytest.mark.parametrize(
    "given", [["t01", 0, 0], ["t01", 3, 0], ["t01", 1], ["", 1, 1], ["t01", -1, 1], 5]
)
def test_faults_that_make_no_sense_are_refused(given: object) -> None:
    stated = cbor2.loads(EXAMPLES[0].encode()) | {14: [given]}
    with pytest.raises(MessageError):
        decode_message(cbor2.dumps(stated, canonical=True))


def test_acknowledgement_comes_back_equal() -> None:
    ack = Acknowledgement(10**18, ((1, 0, 7), (2, 3, 3)))
    assert Acknowledgement.decode(ack.encode()) == ack


@pytest.mark.parametrize("size", [0, 1, 256])
def test_acknowledgement_asks_for_descriptions(size: int) -> None:
    want = tuple(number.to_bytes(32, "big") for number in range(size))
    ack = Acknowledgement(10**18, ((1, 0, 7),), want=want)
    assert Acknowledgement.decode(ack.encode()) == ack


@pytest.mark.parametrize("want", [[], [bytes(31)], ["text"], [bytes(32)] * 257, bytes(32)])
def test_acknowledgement_that_asks_for_no_hash_or_too_many_is_refused(want: object) -> None:
    fields = cbor2.loads(Acknowledgement(10**18, ()).encode()) | {4: want}
    with pytest.raises(MessageError, match="field 4"):
        Acknowledgement.decode(cbor2.dumps(fields, canonical=True))


@given(data=st.binary(max_size=300))
def test_random_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(MessageError):
        decode_message(data)


@given(data=st.data())
def test_mutated_status_is_refused_or_has_the_same_bytes(data: st.DataObject) -> None:
    mutated = bytearray(data.draw(st.sampled_from(EXAMPLES)).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        mutated[data.draw(st.integers(0, len(mutated) - 1))] = data.draw(st.integers(0, 255))
    try:
        back = decode_message(bytes(mutated))
    except MessageError:
        return
    assert back.encode() == bytes(mutated)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({4: [2, 1]}, "reversed"),
        ({5: ""}, "printable"),
        ({7: 2**63}, "allowed is 0"),
        ({3: -1}, "allowed is 0"),
        ({2: True}, "expected an integer"),
        ({99: 1}, "field 99 is unknown"),
        ({1: 77}, "field 1 is 77"),
    ],
)
def test_field_out_of_range_is_named(change: dict[int, object], message: str) -> None:
    with pytest.raises(MessageError, match=message):
        decode_message(dump(cbor2.loads(EXAMPLES[0].encode()) | change))


def test_missing_field_is_named() -> None:
    fields = cbor2.loads(EXAMPLES[0].encode())
    del fields[8]
    with pytest.raises(MessageError, match="field 8 is missing"):
        decode_message(dump(fields))


def test_other_encoding_of_the_same_message_is_refused() -> None:
    good = EXAMPLES[0].encode()
    with pytest.raises(MessageError, match="deterministic"):
        decode_message(good[:2] + b"\x18" + good[2:])
    with pytest.raises(MessageError, match="something follows it"):
        decode_message(good + b"\x00")


CDDL = Path(__file__).parents[3] / "docs" / "eskin.cddl"


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda m: type(m).__name__)
def test_messages_are_as_the_documented_cddl_says(message: Message) -> None:
    schema = pycddl.Schema(CDDL.read_text())
    schema.validate_cbor(message.encode())
    with pytest.raises(pycddl.ValidationError):
        schema.validate_cbor(dump(cbor2.loads(message.encode()) | {77: 1}))
