"""Frames and what belongs to them: any message, and any bounds with any sampling."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cbor2
import numpy as np
from eskin_sensor_node.firmware import sample_codec as firmware

from eskin.errors import MessageError
from eskin.wire.frames import (
    EncodedFrame,
    Frame,
    Layout,
    Patch,
    SampleCodes,
    Sampling,
    Statements,
    decode_samples,
    encode_samples,
)
from eskin.wire.messages.cbor_map import MOST_BYTES
from tests.contract.frames.slow_decoder import decode_frame
from tests.robustness.fuzz.mutations.trees import mutate_tree
from tests.robustness.fuzz.target import Target
from tests.unit.eskin.wire.frames.examples import MESSAGES, head_fields

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.interval import Interval

SLOWEST = 500
"""Samples of a frame that the slow decoder reads, too."""


def make(_: Path) -> Target:
    """Only `MessageError`; what is read says the same bytes again; encoders enclose and agree."""
    return Target(tuple(message.encode() for message in MESSAGES), mutate_tree, check)


def check(data: bytes) -> None:
    """Read it as all that it may be; the compiled look at frames agrees."""
    _check_summary(data)
    for kind in (Patch, Layout, Frame, Statements):
        try:
            message = kind.decode(data)
        except MessageError:
            continue
        assert message.encode() == data, "not the bytes that were read"
        if isinstance(message, Frame):
            _check_frame(message)


def _check_summary(data: bytes) -> None:
    try:
        found = EncodedFrame.decode(data)
    except MessageError:
        found = None
    try:
        frame = Frame.decode(data)
    except MessageError:
        assert found is None, "a frame was found that is none"
        return
    assert found is not None, "a frame was not found"
    expected = EncodedFrame.of(frame, data)
    assert head_fields(found) == head_fields(expected)
    assert found.records.tolist() == expected.records.tolist()


def _check_frame(frame: Frame) -> None:
    assert len(frame.encode()) <= frame.limit <= MOST_BYTES
    for patch, values in zip(frame.patches, frame.values, strict=True):
        sampling = patch.sampling(frame.grids[patch.grid])
        assert (values.inf <= values.sup).all()
        check_encoders(values, sampling, math.ldexp(1.0, patch.samples.exponent))
    if sum(values.size for values in frame.values) <= SLOWEST:
        found = decode_frame(cbor2.dumps(cbor2.loads(frame.encode())))
        assert len(found) == len(frame.patches)


def check_encoders(values: Interval, sampling: Sampling, least_width: float) -> None:
    """Both encoders agree, and what they write encloses the values."""
    encoded = encode_samples(values, sampling, least_width)
    cells = firmware.Sampling(*sampling)
    finest = firmware.finest_exponent(least_width)
    lows, highs = values.inf.ravel().tolist(), values.sup.ravel().tolist()
    by_firmware = firmware.encode_samples(lows, highs, cells, finest)
    assert SampleCodes(*by_firmware) == encoded, "the encoders differ"
    decoded = decode_samples(encoded, sampling)
    mask = np.asarray(sampling.mask)
    assert (decoded.inf <= values.inf)[mask].all(), "a lower bound rose"
    assert (decoded.sup >= values.sup)[mask].all(), "an upper bound fell"
