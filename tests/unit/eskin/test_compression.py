"""A compressed block gives back each of its bytes, and damaged ones are told."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import cbor2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.messages import Block, Encoding, Position
from eskin.wire.messages.cbor_map import dump
from eskin.wire.messages.compression import compress_all, decompress, is_compressed
from eskin.wire.messages.concatenated import Joined
from eskin.wire.messages.stored_bounds import read_bounds
from tests.unit.cloud.messages import gap, peak, status

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

SIZE = st.sampled_from([1, 2, 7, 8, 9, 31, 255, 256, 257, 264, 500, 511, 512, 513, 999, 1000])
BOUND = st.floats(width=32, allow_nan=False)
PAIR = (
    st.tuples(BOUND, BOUND).map(sorted).filter(lambda pair: pair[0] < np.inf and pair[1] > -np.inf)
)
LOW, HIGH = 12, 13


def block(lo: ArrayLike, hi: ArrayLike, encoding: Encoding = Encoding.F32) -> bytes:
    tube = Tube((-5, 10**18), 1_000_000, Interval(lo, hi), "F", 0.5)
    return Block.pack(Position(1, 2), "t01.capacitance", 7, tube, encoding).encode()


def changed(data: bytes, fields: Mapping[int, object]) -> bytes:
    return dump({**cbor2.loads(data), **fields})


def with_bits(lows: NDArray[np.uint32], highs: NDArray[np.uint32]) -> bytes:
    """A block's bytes with bounds of any bits, as no node says them."""
    bounds = {LOW: cbor2.CBORTag(85, lows.tobytes()), HIGH: cbor2.CBORTag(85, highs.tobytes())}
    return changed(block(np.zeros(lows.size), np.ones(lows.size)), bounds)


def compress(data: bytes) -> bytes | None:
    return compress_all(Joined.of([data]))[0]


def noisy(seed: int = 3, n: int = 500) -> bytes:
    """A block of what a sensor with noise of a tenth of its range says."""
    lo = 1e-11 * (1.0 + np.random.default_rng(seed).normal(0.0, 0.1, n))
    return block(lo, lo + 1e-13)


@given(st.lists(PAIR, min_size=1, max_size=300))
def test_block_comes_back_byte_for_byte(pairs: list[tuple[float, float]]) -> None:
    lo, hi = zip(*pairs, strict=True)
    data = block(lo, hi)
    short = compress(data)
    if short is not None:
        assert is_compressed(short)
        assert len(short) < len(data)
        assert decompress(short) == data
        for found, plain in zip(read_bounds(short), read_bounds(data), strict=True):
            np.testing.assert_array_equal(found, plain)


@given(
    n=SIZE,
    seed=st.integers(0, 2**32),
    start=st.integers(0, 2**32 - 1),
    distance=st.integers(0, 2**32 - 1),
    bits=st.integers(0, 32),
    spread=st.integers(0, 32),
)
def test_any_bits_come_back(
    n: int, seed: int, start: int, distance: int, bits: int, spread: int
) -> None:
    """NaN of any payload, both zeros, infinities and reversed bounds, over the whole circle."""
    random = np.random.default_rng(seed)
    lows = (start + random.integers(0, 2**bits, n)).astype(np.uint32)
    highs = (lows + distance + random.integers(0, 2**spread, n)).astype(np.uint32)
    data = with_bits(lows, highs)
    short = compress(data)
    assert short is None or decompress(short) == data


@pytest.mark.parametrize("n", [64, 500, 512, 1000])
def test_noise_leaves_bits_to_spare(n: int) -> None:
    """Bounds of one width, whatever their noise: of 64 bits a sample 30 are left, and the head."""
    data = noisy(n=n)
    short = compress(data)
    assert short is not None
    assert len(short) - (len(data) - 8 * n) < 30 / 8 * n + 64
    for found, plain in zip(read_bounds(short), read_bounds(data), strict=True):
        np.testing.assert_array_equal(found, plain)


def test_widths_near_zero_take_no_more_than_others() -> None:
    """There floats lie closer together, so that the same width is many more of them."""
    lo = np.random.default_rng(5).random(500)
    short = compress(block(lo, lo + 1e-3))
    assert short is not None
    assert len(short) < 4.5 * lo.size


def test_what_would_be_longer_stays_as_it_is() -> None:
    random = np.random.default_rng(7)
    lows, highs = random.integers(0, 2**32, (2, 500)).astype(np.uint32)
    assert compress(with_bits(lows, highs)) is None
    assert compress(noisy(n=1)) is None


@pytest.mark.parametrize("encoding", [Encoding.F64, Encoding.Q16])
def test_other_encodings_stay_as_they_are(encoding: Encoding) -> None:
    assert compress(block(np.linspace(1.0, 2.0, 500), np.linspace(1.5, 2.5, 500), encoding)) is None


def test_messages_side_by_side_are_told_apart() -> None:
    said = [noisy(1), b"", peak(1).encode(), noisy(2), gap(2).encode(), b"\xaf", noisy(3, 9)]
    said += [status(3).encode(), bytes(900), noisy(4)]
    found = compress_all(Joined.of(said))
    assert [None if short is None else decompress(short) for short in found] == [
        *(said[0], None, None, said[3], None, None, None),
        *(None, None, said[9]),
    ]


def test_long_names_come_back() -> None:
    data = changed(noisy(), {4: "t" * 300, 5: "µ" * 100, 17: 0.25})
    short = compress(data)
    assert short is not None
    assert decompress(short) == data
    assert compress(changed(noisy(), {4: "t" * 1024})) is None


@pytest.mark.parametrize("key", [9, 11, LOW, HIGH])
def test_fields_that_lie_are_no_block(key: int) -> None:
    """Of the number of samples, of their encoding, and of where they are."""
    for value in (0, 501, 2**40, -1, b"", b"\0" * 3000, "text", cbor2.CBORTag(85, b"\0\0\0\0")):
        data = changed(noisy(), {key: value})
        short = compress(data)
        assert short is None or decompress(short) == data


@given(st.data())
def test_damaged_bytes_are_told_or_read_within_what_is_there(data: st.DataObject) -> None:
    short = bytearray(compress(noisy()) or b"")
    for _ in range(data.draw(st.integers(0, 3))):
        short[data.draw(st.integers(0, len(short) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(short[: data.draw(st.integers(1, len(short)))])
    with suppress(MessageError):
        decompress(cut)


@pytest.mark.parametrize("size", [1, 7, 8, 100, 200, 1000, -1])
def test_block_that_ends_too_early_is_damaged(size: int) -> None:
    short = compress(noisy()) or b""
    with pytest.raises(MessageError, match="damaged"):
        decompress(short[:size])
    with pytest.raises(MessageError, match="damaged"):
        read_bounds(short + b"\0\0\0\0")


def test_subnormal_bounds_stay_as_they_came() -> None:
    """A processor that takes them for zero would read others."""
    lo = np.full(500, 1.0)
    assert compress(block(lo, lo + 0.5)) is not None
    lo[77] = 1e-40
    assert compress(block(lo, lo + 0.5)) is None
    assert compress(block(np.full(500, -2e-38), np.full(500, -1.9e-38))) is not None
    assert compress(block(np.full(500, -2e-38), np.full(500, -3e-39))) is None
