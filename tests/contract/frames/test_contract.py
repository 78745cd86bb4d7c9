"""Frames mean what ``docs/eskin.cddl`` says, to decoders that know nothing of eskin."""

from __future__ import annotations

import json
import re
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import cbor2
import pycddl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pycose.keys.symmetric import SymmetricKey
from pycose.messages.enc0message import Enc0Message

from eskin.wire.envelope import Sealer
from eskin.wire.envelope.encrypt0 import agree_key
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples, Sampling, Statements
from eskin.wire.messages import Acknowledgement, Position
from tests.contract.frames.slow_decoder import Bound, decode_frame
from tests.contract.frames.vectors import FILE, document, frames
from tests.unit.eskin.wire.frames.examples import MESSAGES
from tests.unit.eskin.wire.frames.matrices import SIZES, matrices, samplings

if TYPE_CHECKING:
    from tests.support.identities import Identities

CDDL = Path(__file__).parents[3] / "docs" / "eskin.cddl"
KINDS = {Patch: "patch", Layout: "layout", Frame: "frame", Statements: "statements"}


def exact(bound: float) -> Bound:
    return None if abs(bound) == float("inf") else Fraction(bound)


def require_same(frame: Frame) -> None:
    """The slow decoder finds the same samples, exactly, and none where there is none."""
    found = decode_frame(frame.encode())
    assert list(found) == [each.patch for each in frame.patches]
    for each, values in zip(frame.patches, frame.values, strict=True):
        mask = each.sampling(frame.grids[each.grid]).mask
        pairs = zip(values.inf.ravel().tolist(), values.sup.ravel().tolist(), strict=True)
        expected = [
            (exact(lo), exact(hi)) if is_sample else None
            for (lo, hi), is_sample in zip(pairs, mask.ravel().tolist(), strict=True)
        ]
        assert [cell for row in found[each.patch] for cell in row] == expected


@pytest.mark.parametrize("number", range(len(frames())))
def test_decoder_written_from_the_cddl_finds_the_same_samples(number: int) -> None:
    require_same(frames()[number])


@settings(deadline=None, max_examples=60)
@given(data=st.data(), sampling=samplings(), least_width=st.sampled_from(SIZES))
def test_slow_decoder_finds_the_same_samples_in_any_frame(
    data: st.DataObject, sampling: Sampling, least_width: float
) -> None:
    if not sum(sampling.counts):
        return
    strides = sampling.strides if any(sampling.strides) else b""
    samples = PatchSamples.pack(
        data.draw(matrices(sampling)), least_width, patch=0, grid=0, first_row=sampling.first_row,
        strides=strides,
    )  # fmt: skip
    grid = Grid(0, 1000, sampling.first_row, sampling.rows, 1.0)
    require_same(Frame(Position(1, 2), bytes(32), 0, 0, (0, 1), (grid,), (samples,)))


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_messages_are_as_the_documented_cddl_says(
    message: Patch | Layout | Frame | Statements,
) -> None:
    rule = KINDS[type(message)]
    any_message = pycddl.Schema(CDDL.read_text())
    alone = pycddl.Schema(re.sub(r"(?m)^message = .*$", f"message = {rule}", CDDL.read_text()))
    any_message.validate_cbor(message.encode())
    alone.validate_cbor(message.encode())
    with pytest.raises(pycddl.ValidationError):
        alone.validate_cbor(cbor2.dumps(cbor2.loads(message.encode()) | {77: 1}))


@pytest.mark.parametrize("size", [0, 1, 256, 257])
def test_acknowledgement_asks_for_descriptions_as_the_documented_cddl_says(size: int) -> None:
    rule = re.sub(r"(?m)^message = .*$", "message = acknowledgement", CDDL.read_text())
    want = tuple(number.to_bytes(32, "big") for number in range(size))
    ack = Acknowledgement(10**18, ((1, 0, 7),), want=want).encode()
    if size <= 256:
        pycddl.Schema(rule).validate_cbor(ack)
    else:
        with pytest.raises(pycddl.ValidationError):
            pycddl.Schema(rule).validate_cbor(ack)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_independent_library_writes_the_same_bytes(
    message: Patch | Layout | Frame | Statements,
) -> None:
    fields = cbor2.loads(message.encode())
    assert list(fields) == sorted(fields)
    assert cbor2.dumps(fields) == message.encode()


def test_independent_cose_library_decrypts_a_frame(identities: Identities) -> None:
    topic, node, site = "eskin/v1/nodes/fingertip/frames", identities.node, identities.site
    frame = max(frames(), key=lambda each: len(each.encode()))
    envelope = Sealer(node, site.certificate).seal(frame.encode(), topic=topic)
    message = Enc0Message.decode(envelope)
    salt = cbor2.loads(cbor2.loads(envelope).value[0])[-20]
    key = agree_key(site.key, node.certificate, node.certificate, site.certificate, salt)
    message.key = SymmetricKey(k=key)
    message.external_aad = topic.encode()
    assert Frame.decode(message.decrypt()) == frame


def test_vectors_for_other_languages_are_current() -> None:
    """Write them anew by ``python -m tests.contract.frames.vectors``."""
    assert json.loads(FILE.read_text()) == document()
