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
from eskin.wire.frames import SampleCodes, Sampling, decode_samples, encode_samples
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
def said() -> tuple[Interval, Sampling, SampleCodes, Interval]:
    """Samples of a patch, their codes, and what these are decoded to."""
    lo = np.random.default_rng(5).random((20, 25))
    values, sampling = Interval(lo, lo + 1e-3), Sampling(20, 25)
    codes = encode_samples(values, sampling, 1e-3)
    return values, sampling, codes, decode_samples(codes, sampling)


def test_samples_are_encoded_and_decoded_alike(odd_mode: int) -> None:
    values, sampling, codes, expected = said()
    assert encode_samples(values, sampling, 1e-3) == codes
    found = decode_samples(codes, sampling)
    assert np.array_equal(found.inf, expected.inf)
    assert np.array_equal(found.sup, expected.sup)
    assert C.fegetround() == odd_mode
