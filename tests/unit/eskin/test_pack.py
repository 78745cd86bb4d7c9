"""Packs give back every block byte for byte, and its samples without going through the block."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.interval import Interval
from eskin.kernels.delta_bitpacking import PADDING, pack_run, run_limit, unpack_run
from eskin.kernels.varints import LONGEST, read_varints, write_varints
from eskin.tube import Tube
from eskin.wire.messages import Block, Encoding, Position
from eskin.wire.messages.compacted_block import Kept, Pack, is_pack, pack
from eskin.wire.messages.stored_bounds import read_bounds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

START = 1_800_000_000_000_000_000
CODES = st.lists(
    st.one_of(st.integers(0, 65_535), st.integers(40_000, 40_050), st.sampled_from([0, 65_535])),
    min_size=1,
    max_size=100,
)


@given(CODES, st.integers(0, 2))
def test_every_run_comes_back_whatever_its_order(codes: list[int], order: int) -> None:
    out = np.full(run_limit(len(codes)), 0xA5, np.uint8)
    size = pack_run(np.array(codes, np.int64), order, out)
    assert size <= out.size - PADDING
    found = np.empty(len(codes), np.uint16)
    assert unpack_run(out.tobytes(), 0, order, found) == size
    assert found.tolist() == codes


@given(st.lists(st.integers(-(2**63), 2**63 - 1) | st.integers(-70, 70), max_size=20))
def test_every_whole_number_comes_back(numbers: list[int]) -> None:
    out = np.empty(len(numbers) * LONGEST + 1, np.uint8)
    size = write_varints(np.array(numbers, np.int64), out)
    found = np.empty(len(numbers), np.int64)
    assert read_varints(out.tobytes(), 0, found) == size
    assert found.tolist() == numbers


def said(
    number: int, lo: Sequence[float] | NDArray[np.float64], width: float, scale: float = 1e-12
) -> Block:
    low = np.asarray(lo, np.float64) * scale
    high = np.nextafter(low + width * scale, np.inf)
    first = START + number * 10**9 - 3 * number
    tube = Tube((first, first + 5 + 6 * number), 1_000_000, Interval(low, high), "F", 0.999)
    position = Position(7, 3 * number + number % 2)
    return Block.pack(position, "t01.capacitance", number * 10**9, tube, Encoding.Q16)


def kept(blocks: Sequence[Block]) -> list[Kept]:
    return [
        Kept(block.encode(), 90 + 11 * k, START + k * 10**8 + k**3)
        for k, block in enumerate(blocks)
    ]


SIGNALS = st.lists(st.integers(-(10**6), 10**6), min_size=1, max_size=70)


@given(st.lists(SIGNALS, min_size=1, max_size=4), st.floats(0.01, 1e3))
def test_blocks_come_back_byte_for_byte(signals: list[list[int]], width: float) -> None:
    blocks = [said(k, np.array(lo, np.float64), width) for k, lo in enumerate(signals)]
    data = pack(kept(blocks))
    assert is_pack(data)
    assert not any(is_pack(block.encode()) for block in blocks)
    assert Pack.read(data).blocks() == kept(blocks)
    lo, hi = read_bounds(data)
    assert lo.tolist() == [x for block in blocks for x in block.tube.values.inf.tolist()]
    assert hi.tolist() == [x for block in blocks for x in block.tube.values.sup.tolist()]


def test_unbounded_and_missing_samples_come_back() -> None:
    lo = np.array([1.0, -np.inf, -np.inf, 2.0, 3.0])
    hi = np.array([1.5, 2.0, np.inf, np.inf, 3.5])
    tube = Tube((START, START), 10, Interval(lo, hi), "F", 1.0)
    block = Block.pack(Position(1, 1), "t01.capacitance", 0, tube, Encoding.Q16)
    data = pack(kept([block]))
    assert Pack.read(data).blocks()[0].data == block.encode()
    found = read_bounds(data)
    assert found[0].tolist() == block.tube.values.inf.tolist()
    assert found[1].tolist() == block.tube.values.sup.tolist()


def test_pack_is_less_than_half_also_of_a_noisy_signal() -> None:
    random = np.random.default_rng(3)
    t = np.arange(1000)
    lo = 100.0 * np.sin(t / 80) + random.normal(0, 0.4, t.size)
    blocks = [said(k, lo[250 * k : 250 * k + 250], 1.5) for k in range(4)]
    data = pack(kept(blocks))
    assert len(data) < 0.5 * sum(len(block.encode()) for block in blocks)


def test_what_is_not_alike_is_not_packed() -> None:
    one = said(0, [1.0, 2.0], 0.1)
    tube = Tube((START, START), 2_000_000, one.tube.values, "F", 0.999)
    other = Block.pack(Position(7, 9), "t01.capacitance", 0, tube, Encoding.Q16)
    with pytest.raises(MessageError, match="one channel"):
        pack(kept([one, other]))
    floats = Block.pack(Position(7, 9), "t01.capacitance", 0, one.tube, Encoding.F32)
    with pytest.raises(MessageError, match="only q16"):
        pack(kept([floats]))
    tiny = said(0, [1.0, 2.0], 0.1, 1e-300)
    with pytest.raises(MessageError, match="only q16"):
        pack(kept([tiny]))
