"""A library that leaves the processor rounding upward does not spoil an enclosure."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import numpy as np
import pytest

from eskin import models
from eskin.interval import Interval
from eskin.kernels.rounding_mode import rounding_to_nearest, rounds_to_nearest
from eskin.peaks import find_peaks
from eskin.tube import Tube
from eskin.wire.messages import Block, Encoding, Position
from eskin.wire.messages.compression import compress_all, decompress
from eskin.wire.messages.concatenated import Joined
from tests.unit.eskin.peaks.firmware import Detector

if TYPE_CHECKING:
    from collections.abc import Iterator

C = ctypes.CDLL(None)
TIMES = np.linspace(0.0, 1.0, 1000)


@pytest.fixture(params=[0x400, 0x800, 0xC00])
def odd_mode(request: pytest.FixtureRequest) -> Iterator[int]:
    """Downward, upward, towards zero, as an x86 numbers them."""
    if C.fesetround(request.param) != 0:  # another processor than x86, whose numbers these are
        pytest.skip("this processor numbers its rounding modes otherwise")
    yield request.param
    C.fesetround(0)


def test_nearest_is_the_rule() -> None:
    assert rounds_to_nearest()


def test_other_modes_are_noticed(odd_mode: int) -> None:
    assert C.fegetround() == odd_mode
    assert not rounds_to_nearest()


def test_function_rounds_to_nearest_and_the_mode_comes_back(odd_mode: int) -> None:
    seen = rounding_to_nearest(C.fegetround)()
    assert seen == 0
    assert C.fegetround() == odd_mode


def test_mode_comes_back_after_an_error(odd_mode: int) -> None:
    def fail() -> None:
        raise KeyError

    with pytest.raises(KeyError):
        rounding_to_nearest(fail)()
    assert C.fegetround() == odd_mode


def test_model_gives_the_same_bounds_in_every_mode(odd_mode: int) -> None:
    def evaluate() -> bytes:
        chain = models.capacitive_chain(
            TIMES,
            minimum_capacitance=1e-11,
            maximum_capacitance=1e-10,
            resistance=1e3,
            transconductance=1e-3,
        )
        return chain.current.inf.tobytes() + chain.current.sup.tobytes()

    assert evaluate() == rounding_to_nearest(evaluate)()
    assert C.fegetround() == odd_mode


def test_peaks_are_found_as_if_it_rounded_to_nearest(odd_mode: int) -> None:
    assert C.fegetround() == odd_mode
    lows, highs = [0.1, 7.7, 0.2] * 20, [0.3, 7.9, 0.7] * 20
    expected = list(rounding_to_nearest(Detector(1.0).feed)(lows, highs))
    assert list(find_peaks(lows, highs, prominence=1.0)) == expected


@rounding_to_nearest
def said() -> tuple[bytes, bytes | None]:
    """A block of ``f32``, and what it is compressed."""
    lo = np.random.default_rng(5).random(500)
    tube = Tube((0, 0), 1_000_000, Interval(lo, lo + 1e-3), "F", 1.0)
    data = Block.pack(Position(1, 2), "t01.capacitance", 7, tube, Encoding.F32).encode()
    return data, compress_all(Joined.of([data]))[0]


def test_compressed_blocks_are_written_and_read_alike(odd_mode: int) -> None:
    data, short = said()
    assert short is not None
    assert compress_all(Joined.of([data])) == [short]
    assert decompress(short) == data
    assert C.fegetround() == odd_mode
