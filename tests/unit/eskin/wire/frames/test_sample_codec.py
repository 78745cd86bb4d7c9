"""Samples come back as intervals that enclose them, at most a quantum wider on each side."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from eskin_sensor_node.firmware import sample_codec as firmware
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.interval import Interval
from eskin.wire.frames import SampleCodes, Sampling, decode_samples, encode_samples
from tests.unit.eskin.wire.frames.matrices import SIZES, matrices, samplings

FAR = 2.0**950
WIDTHS = st.sampled_from(SIZES)


def encoded_by_firmware(values: Interval, sampling: Sampling, least_width: float) -> SampleCodes:
    cells = firmware.Sampling(*sampling)
    lows, highs = values.inf.ravel().tolist(), values.sup.ravel().tolist()
    finest = firmware.finest_exponent(least_width)
    return SampleCodes(*firmware.encode_samples(lows, highs, cells, finest))


@settings(deadline=None)
@given(data=st.data(), sampling=samplings(), least_width=WIDTHS)
def test_decoded_encloses_and_is_a_quantum_wider_at_most(
    data: st.DataObject, sampling: Sampling, least_width: float
) -> None:
    values = data.draw(matrices(sampling))
    encoded = encode_samples(values, sampling, least_width)
    decoded, quantum = decode_samples(encoded, sampling), Fraction(2) ** encoded.exponent
    mask = sampling.mask
    assert np.all(decoded.inf[mask] <= values.inf[mask])
    assert np.all(decoded.sup[mask] >= values.sup[mask])
    assert np.all(decoded[~mask].inf == -np.inf)
    assert np.all(decoded[~mask].sup == np.inf)
    given_, written = values[mask], decoded[mask]
    for exact, wide in ((given_.inf, written.inf), (-given_.sup, -written.sup)):
        assert np.all(np.isinf(wide) == (np.isinf(exact) | (exact < -FAR)))
        for bound, far in zip(exact.tolist(), wide.tolist(), strict=True):
            if abs(bound) <= FAR:
                assert Fraction(bound) - Fraction(far) < quantum
                assert Fraction(far) % quantum == 0


@settings(deadline=None)
@given(data=st.data(), sampling=samplings(), least_width=WIDTHS)
def test_firmware_writes_the_same_bytes(
    data: st.DataObject, sampling: Sampling, least_width: float
) -> None:
    values = data.draw(matrices(sampling))
    encoded = encode_samples(values, sampling, least_width)
    assert encoded_by_firmware(values, sampling, least_width) == encoded


@settings(deadline=None)
@given(data=st.data(), sampling=samplings(), least_width=WIDTHS)
def test_codes_stay_within_their_limit(
    data: st.DataObject, sampling: Sampling, least_width: float
) -> None:
    encoded = encode_samples(data.draw(matrices(sampling)), sampling, least_width)
    assert len(encoded.codes) <= sampling.limit
    assert sampling.counts == sampling.mask.sum(axis=0).tolist()


def test_worst_samples_reach_the_limit() -> None:
    """The farthest differences have 24 bits; nothing that follows compresses them."""
    sampling = Sampling(5, 64)
    chess = np.indices((5, 64)).sum(axis=0) % 2
    lo = np.where(chess, 0.0, 2.0**23 + 5)
    hi = np.where(chess, 2.0**23 + 2, lo)
    encoded = encode_samples(Interval(lo, hi), sampling, 64.0)
    assert encoded.exponent == 0
    assert len(encoded.codes) == sampling.limit == 6 * 5 * 64 + 2 * 5


@pytest.mark.parametrize("least_width", [1.0, 3.7, 1e-12, 2.0**-10])
def test_quantum_is_between_a_64th_and_a_128th_of_the_least_width(least_width: float) -> None:
    values = Interval(np.full((3, 2), 0.3), np.full((3, 2), 0.3 + least_width))
    exponent = encode_samples(values, Sampling(3, 2), least_width).exponent
    assert least_width / 128 < math.ldexp(1.0, exponent) <= least_width / 64


def test_quantum_is_coarser_only_where_codes_would_not_fit() -> None:
    wide = Interval(np.array([[0.0, 1.0]]), np.array([[1.0, 2.0**24]]))
    assert encode_samples(wide, Sampling(1, 2), 64.0).exponent == 1
    fits = Interval(np.array([[0.0, 1.0]]), np.array([[1.0, 2.0**24 - 4]]))
    assert encode_samples(fits, Sampling(1, 2), 64.0).exponent == 0
    one_more = Interval(np.array([[0.0, 1.0]]), np.array([[1.0, 2.0**24 - 3]]))
    assert encode_samples(one_more, Sampling(1, 2), 64.0).exponent == 1
    far = Interval(np.array([[2.0**53]]), np.array([[2.0**53 + 2]]))
    assert encode_samples(far, Sampling(1, 1), 64.0).exponent == 2


@settings(deadline=None)
@given(data=st.data(), sampling=samplings(), least_width=st.sampled_from((1e-3, 1.0)))
def test_what_was_decoded_is_encoded_to_the_same_samples(
    data: st.DataObject, sampling: Sampling, least_width: float
) -> None:
    encoded = encode_samples(data.draw(matrices(sampling)), sampling, least_width)
    decoded = decode_samples(encoded, sampling)
    again = encode_samples(decoded, sampling, math.ldexp(1.0, min(encoded.exponent + 6, 1000)))
    if again.exponent == encoded.exponent:
        assert decode_samples(again, sampling).inf.tolist() == decoded.inf.tolist()
        assert decode_samples(again, sampling).sup.tolist() == decoded.sup.tolist()


def test_no_other_codes_mean_the_same_samples() -> None:
    """Every change of a byte is refused, or decoded to other samples."""
    sampling = Sampling(3, 3, 1, bytes((0, 1, 0)))
    lo = np.array([[1.0, -np.inf, 3.0], [1.5, 2.0, -np.inf], [1.0, 9.0, 4.0]])
    hi = np.array([[2.0, np.inf, 4.0], [np.inf, 3.0, 8.0], [2.0, 11.0, 5.0]])
    encoded = encode_samples(Interval(lo, hi), sampling, 1.0)
    good = decode_samples(encoded, sampling)
    for place in range(len(encoded.codes)):
        for value in range(256):
            codes = bytearray(encoded.codes)
            codes[place] = value
            try:
                found = decode_samples(encoded._replace(codes=bytes(codes)), sampling)
            except MessageError:
                continue
            same = np.array_equal(found.inf, good.inf) and np.array_equal(found.sup, good.sup)
            assert same is (bytes(codes) == encoded.codes)
    for wrong in (encoded.codes[:-1], encoded.codes + b"\0", b""):
        with pytest.raises(MessageError):
            decode_samples(encoded._replace(codes=wrong), sampling)


@pytest.mark.parametrize(
    ("codes", "is_good"),
    [
        ("00 03 04", True),  # base 0, kind 2: lo alone
        ("01 00 03 04", False),  # the base in a bit that it does not need
        ("00 04 04", False),
        ("02 02 03 04", True),  # base 1
        ("00 00", True),  # base 0, kind 0: unknown
        ("02 02 00", False),  # an unknown sample with a base
        ("00 03 0c", False),  # a bit beyond the group
        ("19 00 00 00 00 00", False),  # 25 bits
    ],
)
def test_a_sample_has_one_form(codes: str, is_good: bool) -> None:  # noqa: FBT001
    encoded = SampleCodes(0, 5, bytes.fromhex(codes))
    if is_good:
        assert decode_samples(encoded, Sampling(1, 1)).inf in (5.0, 6.0, -np.inf)
    else:
        with pytest.raises(MessageError):
            decode_samples(encoded, Sampling(1, 1))


@settings(deadline=None)
@given(codes=st.binary(max_size=60), sampling=samplings())
def test_any_bytes_are_refused_or_intervals(codes: bytes, sampling: Sampling) -> None:
    try:
        decoded = decode_samples(SampleCodes(-3, 7, codes), sampling)
    except MessageError:
        return
    assert np.all(decoded.inf <= decoded.sup)


def test_empty_intervals_and_other_shapes_are_refused() -> None:
    with pytest.raises(MessageError):
        encode_samples(Interval.empty((2, 2)), Sampling(2, 2), 1.0)
    with pytest.raises(MessageError):
        encode_samples(Interval(np.zeros((2, 3))), Sampling(3, 2), 1.0)
