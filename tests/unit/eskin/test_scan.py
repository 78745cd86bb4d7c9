"""One look at a block finds what reading it finds, and no block passes that lies of its samples."""

from __future__ import annotations

import math
import struct
from typing import Any

import cbor2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.messages import Block, Encoding, Position, decode_summary
from eskin.wire.messages.cbor_map import dump
from eskin.wire.messages.concatenated import Joined
from eskin.wire.messages.fast_decode import scan, scan_all

BOUND = st.floats(allow_nan=False)
PAIR = (
    st.tuples(BOUND, BOUND).map(sorted).filter(lambda pair: pair[0] < np.inf and pair[1] > -np.inf)
)
COUNT = st.integers(0, 2**53 - 1) | st.sampled_from([0, 23, 24, 255, 256, 65535, 65536, 2**32])
MOMENT = st.integers(-(2**63) + 1, 2**63 - 1)
TYPES = {Encoding.F64: "<f8", Encoding.F32: "<f4", Encoding.Q16: "<u2"}
LOW, HIGH, BOUNDS = 12, 13, 14


def block(
    pairs: list[Any],
    encoding: Encoding,
    *,
    place: tuple[int, int] = (1, 2),
    ticks: int = 7,
    time: tuple[int, int] = (-5, 10**18),
) -> Block:
    values = Interval([pair[0] for pair in pairs], [pair[1] for pair in pairs])
    tube = Tube(time, 1_000_000, values, "F", 0.5)
    return Block.pack(Position(*place), "t01.capacitance", ticks, tube, encoding)


def changed(said: Block, fields: dict[int, object]) -> bytes:
    return dump({**cbor2.loads(said.encode()), **fields})


def samples(said: Block, key: int) -> Any:
    return np.frombuffer(cbor2.loads(said.encode())[key].value, TYPES[said.encoding]).copy()


def typed(said: Block, array: Any) -> cbor2.CBORTag:
    return cbor2.CBORTag(cbor2.loads(said.encode())[LOW].tag, array.tobytes())


def refuse(data: bytes) -> None:
    assert scan(data) is None
    with pytest.raises(MessageError):
        decode_summary(data)


@pytest.mark.parametrize("encoding", Encoding)
@given(
    pairs=st.lists(PAIR, min_size=1, max_size=40),
    place=st.tuples(COUNT, COUNT),
    ticks=COUNT,
    time=st.tuples(MOMENT, MOMENT).map(lambda pair: (min(pair), max(pair))),
)
def test_scan_finds_what_reading_finds(
    encoding: Encoding,
    pairs: list[Any],
    place: tuple[int, int],
    ticks: int,
    time: tuple[int, int],
) -> None:
    said = block(pairs, encoding, place=place, ticks=ticks, time=time)
    assert decode_summary(said.encode()) == Block.decode(said.encode()).summary
    if all(x == 0.0 or 1e-30 < abs(x) < 1e30 or math.isinf(x) for pair in pairs for x in pair):
        assert scan(said.encode()) == said.summary


@pytest.mark.parametrize("encoding", Encoding)
def test_ordinary_blocks_need_no_second_look(encoding: Encoding) -> None:
    for n in (1, 2, 250, 1000):
        lows = np.sin(np.arange(n)) * 1e-11
        pairs = [*zip(lows, lows + 1e-13, strict=True)]
        assert scan(block(pairs, encoding).encode()) is not None
        pairs[n // 2] = (-math.inf, math.inf)
        assert scan(block(pairs, encoding).encode()) is not None


@pytest.mark.parametrize("encoding", Encoding)
@given(
    pairs=st.lists(st.tuples(st.floats(-9, 0), st.floats(1, 9)), min_size=3, max_size=30),
    data=st.data(),
)
def test_sample_outside_of_the_bounds_is_refused(
    encoding: Encoding, pairs: list[Any], data: st.DataObject
) -> None:
    """Wherever it stands, and were it by the least step that the encoding has."""
    said = block(pairs, encoding)
    at = data.draw(st.integers(0, len(pairs) - 1))
    lows, highs = samples(said, LOW), samples(said, HIGH)
    if encoding is Encoding.Q16:
        lows[at], highs[at] = lows.min() - 1, highs.max() + 1
    else:
        lows[at] = np.nextafter(lows.min(), lows.dtype.type(-np.inf))
        highs[at] = np.nextafter(highs.max(), highs.dtype.type(np.inf))
    refuse(changed(said, {LOW: typed(said, lows)}))
    refuse(changed(said, {HIGH: typed(said, highs)}))


@pytest.mark.parametrize("encoding", Encoding)
def test_bounds_wider_or_narrower_than_the_samples_are_refused(encoding: Encoding) -> None:
    said = block([(1.0, 2.0), (1.5, 3.0), (1.25, 2.5)], encoding)
    lo, hi = said.bounds
    for bounds in (
        [math.nextafter(lo, 0), hi],
        [math.nextafter(lo, 9), hi],
        [lo, math.nextafter(hi, 0)],
        [lo, math.nextafter(hi, 9)],
        [-math.inf, hi],
        [lo, math.inf],
        [math.nan, hi],
        [lo, math.nan],
    ):
        refuse(changed(said, {BOUNDS: bounds}))


@pytest.mark.parametrize("encoding", [Encoding.F64, Encoding.F32])
def test_nan_and_reversed_samples_are_refused(encoding: Encoding) -> None:
    said = block([(1.0, 2.0), (1.5, 3.0), (1.25, 2.5)], encoding)
    for key, wrong in ((LOW, math.nan), (HIGH, math.nan), (LOW, 2.75), (HIGH, 1.125)):
        array = samples(said, key)
        array[2] = wrong
        refuse(changed(said, {key: typed(said, array)}))


@pytest.mark.parametrize("encoding", [Encoding.F64, Encoding.F32])
@pytest.mark.parametrize("one", [-math.inf, math.inf])
def test_infinity_is_no_sample(encoding: Encoding, one: float) -> None:
    said = block([(1.0, 2.0), (1.5, 3.0), (1.25, 2.5)], encoding)
    lows, highs = samples(said, LOW), samples(said, HIGH)
    lows[1] = highs[1] = one
    arrays = {LOW: typed(said, lows), HIGH: typed(said, highs)}
    refuse(changed(said, {**arrays, BOUNDS: [min(1.0, one), max(2.5, one)]}))


def test_reversed_codes_are_refused() -> None:
    said = block([(1.0, 2.0), (1.5, 3.0), (1.25, 2.5)], Encoding.Q16)
    lows, highs = samples(said, LOW), samples(said, HIGH)
    lows[2], highs[2] = highs[2], lows[2]
    refuse(changed(said, {LOW: typed(said, lows), HIGH: typed(said, highs)}))


@pytest.mark.parametrize("encoding", Encoding)
@given(data=st.data())
def test_damaged_bytes_are_found_to_say_what_reading_says(
    encoding: Encoding, data: st.DataObject
) -> None:
    said = bytearray(block([(1.0, 2.0), (1.5, 3.0)], encoding).encode())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(said) - 1))
        said[at] = data.draw(st.integers(0, 255))
    damaged = bytes(said[: data.draw(st.integers(0, len(said)) | st.just(len(said)))])
    found = scan(damaged)
    if found is not None:
        assert found == Block.decode(damaged).summary


@given(
    kept=st.lists(
        st.tuples(st.sampled_from(Encoding), st.integers(0, 200), st.binary(max_size=3)), max_size=9
    )
)
def test_message_among_others_is_read_as_if_it_were_alone(
    kept: list[tuple[Encoding, int, bytes]],
) -> None:
    """None is read into the next one, however it is cut."""
    said = [
        block([(1.0, 2.0), (1.5, 3.0)], encoding, ticks=cut).encode()[: cut or None] + more
        for encoding, cut, more in kept
    ]
    assert scan_all(Joined.of(said)) == [scan(data) for data in said]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        (1, 2),
        (2, 2**53),
        (2, -1),
        (4, "no channel"),
        (5, "a unit that is too long"),
        (5, "\n"),
        (7, [6, 5]),
        (7, [-(2**63), 5]),
        (8, 0),
        (8, 10**12 + 1),
        (9, 1),
        (9, 3),
        (10, 1.5),
        (10, math.nan),
        (10, 1),
        (11, 3),
        (12, b"\0\0\0\0"),
        (15, 1024),
        (16, 2**53 + 1),
        (17, -1.0),
        (18, 0),
    ],
)
def test_fields_out_of_their_range_are_refused(key: int, value: object) -> None:
    refuse(changed(block([(1.0, 2.0), (1.5, 3.0)], Encoding.Q16), {key: value}))


@pytest.mark.parametrize("encoding", Encoding)
def test_samples_of_another_type_or_number_are_refused(encoding: Encoding) -> None:
    said = block([(1.0, 2.0), (1.5, 3.0)], encoding)
    lows = samples(said, LOW)
    refuse(changed(said, {LOW: typed(said, np.append(lows, lows[-1:]))}))
    refuse(changed(said, {LOW: typed(said, lows[:1])}))
    for tag in (69, 85, 86):
        if tag != typed(said, lows).tag:
            refuse(changed(said, {LOW: cbor2.CBORTag(tag, lows.tobytes())}))
    refuse(changed(said, {LOW: lows.tobytes()}))


def test_offset_beyond_its_range_is_refused() -> None:
    said = block([(1.0, 2.0), (1.5, 3.0)], Encoding.Q16)
    codes = samples(said, LOW).min(), samples(said, HIGH).max()
    for offset, good in ((2**53, True), (2**53 + 2, False)):
        bounds = [float(int(code) + offset) * 2.0**-3 for code in codes]
        data = changed(said, {15: -3, 16: offset, BOUNDS: bounds})
        if good:
            assert decode_summary(data) == scan(data)
        else:
            refuse(data)


def test_bytes_that_follow_or_lack_are_refused() -> None:
    good = block([(1.0, 2.0)], Encoding.F64).encode()
    for damaged in (good + b"\0", good[:-1], b""):
        refuse(damaged)


@pytest.mark.parametrize("encoding", Encoding)
def test_map_that_counts_other_pairs_is_refused(encoding: Encoding) -> None:
    good = block([(1.0, 2.0)], encoding).encode()
    for head in (b"\xae", b"\xaf", b"\xb0", b"\xb1", b"\x8f"):
        if head != good[:1]:
            refuse(head + good[1:])


@pytest.mark.parametrize("encoding", Encoding)
@pytest.mark.parametrize("n", [0, 1001])
def test_no_samples_and_too_many_are_refused(encoding: Encoding, n: int) -> None:
    said = block([(1.0, 2.0)], encoding)
    arrays = {key: typed(said, np.resize(samples(said, key), n)) for key in (LOW, HIGH)}
    bounds = said.bounds if n else (math.inf, -math.inf)
    refuse(changed(said, {9: n, BOUNDS: list(bounds), **arrays}))


def test_infinite_bound_has_one_form() -> None:
    good = block([(1.0, math.inf)], Encoding.F64).encode()
    assert scan(good) is not None
    refuse(good.replace(b"\xf9\x7c\0", b"\xfb\x7f\xf0" + bytes(6), 1))


def test_numbers_longer_than_needed_are_refused() -> None:
    """One message has one form (RFC 8949, section 4.2)."""
    good = block([(1.0, 2.0)], Encoding.F64, place=(5, 6)).encode()
    for longer in (b"\x18\x05", b"\x19\0\x05", b"\x1a\0\0\0\x05", b"\x1b" + struct.pack(">q", 5)):
        refuse(good.replace(b"\x02\x05\x03\x06", b"\x02" + longer + b"\x03\x06", 1))
    assert scan(good) is not None


def test_unit_beyond_ascii_is_read() -> None:
    tube = Tube((0, 0), 1, Interval(1.0, 2.0)[None], "µm", 1.0)
    said = Block.pack(Position(1, 1), "t01.x", 0, tube, Encoding.F64)
    assert decode_summary(said.encode()) == said.summary
