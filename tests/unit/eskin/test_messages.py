"""Messages come back as they went; what is no message is refused with its place and value."""

from __future__ import annotations

import math
from pathlib import Path

import cbor2
import numpy as np
import pycddl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.interval import Interval, Verdict
from eskin.tube import Tube
from eskin.wire.messages import (
    Acknowledgement,
    Block,
    ChannelInfo,
    Encoding,
    Gap,
    Message,
    Peak,
    Place,
    Position,
    ResetCause,
    Status,
    TaxelFaults,
    decode_message,
)
from eskin.wire.messages.cbor_map import dump

BOUND = st.floats(allow_nan=False)
PAIR = (
    st.tuples(BOUND, BOUND).map(sorted).filter(lambda pair: pair[0] < np.inf and pair[1] > -np.inf)
)


def block_of(pairs: list[list[float]], encoding: Encoding) -> tuple[Block, Interval]:
    values = Interval([p[0] for p in pairs], [p[1] for p in pairs])
    tube = Tube((-5, 10**18), 1_000_000, values, "F", 0.5)
    return Block.pack(Position(1, 2), "t01.capacitance", 7, tube, encoding), values


@pytest.mark.parametrize("encoding", Encoding)
@given(pairs=st.lists(PAIR, min_size=1, max_size=40))
def test_encoding_only_widens_and_says_by_how_much(
    encoding: Encoding, pairs: list[list[float]]
) -> None:
    block, values = block_of(pairs, encoding)
    back = Block.decode(block.encode())
    written = back.tube.values
    assert np.all(values.subset(written))
    with np.errstate(invalid="ignore", over="ignore"):
        moved = np.concatenate([values.inf - written.inf, written.sup - values.sup])
    assert np.all(moved[np.isfinite(moved)] <= back.widening)
    assert back.bounds == (written.inf.min(), written.sup.max())
    if encoding is Encoding.F64:
        assert back.widening == 0.0


@pytest.mark.parametrize("encoding", Encoding)
@given(pairs=st.lists(PAIR, min_size=1, max_size=40))
def test_block_comes_back_equal_and_byte_for_byte(
    encoding: Encoding, pairs: list[list[float]]
) -> None:
    block, _ = block_of(pairs, encoding)
    back = Block.decode(block.encode())
    assert back.encode() == block.encode()
    assert (back.position, back.channel, back.ticks) == (block.position, block.channel, 7)
    assert back.tube.time == (-5, 10**18)
    again = Block.pack(back.position, back.channel, back.ticks, back.tube, encoding)
    assert np.array_equal(again.tube.values.inf, back.tube.values.inf)
    assert np.array_equal(again.tube.values.sup, back.tube.values.sup)


@given(
    middle=st.floats(1e-12, 1e3),
    spread=st.floats(1e-6, 1.0),
    n=st.integers(2, 200),
)
def test_q16_is_as_fine_as_16_bits_allow(middle: float, spread: float, n: int) -> None:
    x = middle * (1 + spread * np.sin(np.linspace(0, 6, n)))
    values = Interval(x, x)
    tube = Tube((0, 0), 1, values, "1", 1.0)
    block = Block.pack(Position(0, 0), "t.x", 0, tube, Encoding.Q16)
    span = float(x.max() - x.min())
    assert block.widening <= span / 16_000 + 4 * math.ulp(float(x.max()))


def test_unbounded_sides_and_missing_samples_survive() -> None:
    inf = math.inf
    for encoding in Encoding:
        block, values = block_of([[-inf, 1.0], [0.5, inf], [-inf, inf], [0.25, 0.5]], encoding)
        back = Block.decode(block.encode()).tube.values
        assert np.array_equal(np.isinf(back.inf), np.isinf(values.inf))
        assert np.array_equal(np.isinf(back.sup), np.isinf(values.sup))


EXAMPLES: list[Message] = [
    Peak(
        Position(3, 4), "t01.current", "A", (5, 9), Verdict.CERTAIN, (1, 1), (1.0, 1.5),
        (0.5, math.inf), 0.999,
    ),
    Gap(Position(3, 5), "flash full", (1, 2), 7, 1750, ((1, 0, 6), (2, 1, 1))),
    Status(
        Position(3, 6), (1, 2), "fingertip", "three taxels", 10**9, 1, 2, 3, 4,
        (ChannelInfo("t01.current", "A", 1_000_000, 1.0),),
    ),
    Status(Position(3, 7), (1, 2), "palm", "a palm", 10**9, 1, 2, 3, 4, (), ResetCause.WATCHDOG),
    Status(
        Position(3, 8), (1, 2), "palm", "a palm", 10**9, 1, 2, 3, 4, (),
        faults=(TaxelFaults("t01", Verdict.CERTAIN, Verdict.POSSIBLE),),
    ),
    Status(Position(3, 9), (1, 2), "palm", "a palm", 10**9, 1, 2, 3, 4, (), faults=()),
    Status(
        Position(3, 8), (1, 2), "hand", "a hand", 10**9, 1, 2, 3, 4, (),
        places=(Place("t00", 0.01, -0.02), Place("t01", 0.03, 0.0)), gateway_time=-5,
    ),
]  # fmt: skip


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda m: type(m).__name__)
def test_message_comes_back_equal(message: Message) -> None:
    assert decode_message(message.encode()) == message


@pytest.mark.parametrize(
    ("messages", "samples", "said"),
    [
        (0, 0, "t05 certainly stuck"),
        (0, 1, "t05 certainly stuck: 1 sample lost"),
        (1, 200, "t05 certainly stuck: 1 message and 200 samples lost"),
    ],
)
def test_gap_tells_people_what_was_lost_if_anything(messages: int, samples: int, said: str) -> None:
    assert Gap(Position(3, 5), "t05 certainly stuck", (1, 2), messages, samples, ()).detail == said


@pytest.mark.parametrize(
    "given", [["t01", 0, 0], ["t01", 3, 0], ["t01", 1], ["", 1, 1], ["t01", -1, 1], 5]
)
def test_faults_that_make_no_sense_are_refused(given: object) -> None:
    told = cbor2.loads(EXAMPLES[-2].encode()) | {17: [given]}
    with pytest.raises(MessageError):
        decode_message(cbor2.dumps(told, canonical=True))


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
def test_mutated_block_is_refused_or_still_an_interval(data: st.DataObject) -> None:
    good, _ = block_of([[0.0, 1.0], [1.0, 2.0]], data.draw(st.sampled_from(list(Encoding))))
    mutated = bytearray(good.encode())
    for _ in range(data.draw(st.integers(1, 4))):
        mutated[data.draw(st.integers(0, len(mutated) - 1))] = data.draw(st.integers(0, 255))
    try:
        back = decode_message(bytes(mutated))
    except MessageError:
        return
    assert isinstance(back, Block)
    assert np.all(back.tube.values.inf <= back.tube.values.sup)
    assert back.encode() == bytes(mutated)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({9: 3}, "does not hold 3 samples"),
        ({9: 1001}, "allowed is 1 to 1000"),
        ({14: [0.0, 1.0]}, "not the hull"),
        ({10: 1.5}, "allowed is 0.0 to 1.0"),
        ({10: float("nan")}, "allowed is"),
        ({8: 0}, "allowed is 1"),
        ({7: [2, 1]}, "reversed"),
        ({4: "no channel"}, "TAXEL.QUANTITY"),
        ({5: ""}, "printable"),
        ({3: -1}, "allowed is 0"),
        ({2: True}, "expected an integer"),
        ({99: 1}, "field 99 is unknown"),
        ({1: 9}, "kinds 1 to 5"),
        ({12: b"raw"}, "no typed array"),
    ],
)
def test_field_out_of_range_is_named(change: dict[int, object], message: str) -> None:
    good, _ = block_of([[0.0, 1.0], [1.0, 2.0]], Encoding.F64)
    with pytest.raises(MessageError, match=message):
        decode_message(dump(cbor2.loads(good.encode()) | change))


def test_missing_field_is_named() -> None:
    good, _ = block_of([[0.0, 1.0]], Encoding.F64)
    fields = cbor2.loads(good.encode())
    del fields[8]
    with pytest.raises(MessageError, match="field 8 is missing"):
        decode_message(dump(fields))


def test_other_encoding_of_the_same_message_is_refused() -> None:
    good = EXAMPLES[0].encode()
    with pytest.raises(MessageError, match="deterministic"):
        decode_message(good[:2] + b"\x18" + good[2:])
    with pytest.raises(MessageError, match="something follows it"):
        decode_message(good + b"\x00")


@pytest.mark.parametrize("n", [0, 1001])
def test_block_of_no_or_too_many_samples_is_refused(n: int) -> None:
    tube = Tube((0, 0), 1, Interval(np.zeros(n)), "F", 1.0)
    with pytest.raises(MessageError, match="1 to 1000 samples"):
        Block.pack(Position(0, 0), "t.x", 0, tube, Encoding.F32)


CDDL = Path(__file__).parents[3] / "docs" / "eskin.cddl"


@pytest.mark.parametrize(
    "message",
    [*EXAMPLES, *(block_of([[0.0, 1.0], [1.0, math.inf]], e)[0] for e in Encoding)],
    ids=lambda m: type(m).__name__,
)
def test_messages_are_as_the_documented_cddl_says(message: Message) -> None:
    schema = pycddl.Schema(CDDL.read_text())
    schema.validate_cbor(message.encode())
    with pytest.raises(pycddl.ValidationError):
        schema.validate_cbor(dump(cbor2.loads(message.encode()) | {77: 1}))


@pytest.mark.parametrize(
    ("places", "reason"),
    [
        ([], "no taxel"),
        ([["t00", 0.0, 0.0], ["t00", 1.0, 0.0]], "one twice"),
        ([["t00", 0.0]], "2 items"),
        ([["T 0", 0.0, 0.0]], "'T 0'"),
        ([["t00", 0, 0.0]], "expected a float"),
        ([["t00", 0.0, 101.0]], "101.0"),
    ],
)
def test_places_that_are_none_are_refused(places: list[object], reason: str) -> None:
    fields = cbor2.loads(EXAMPLES[-1].encode()) | {18: places}
    with pytest.raises(MessageError, match=reason):
        decode_message(dump(fields))
