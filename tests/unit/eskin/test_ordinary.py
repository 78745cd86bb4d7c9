"""What the short way reads of an envelope is what the general way reads."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import EnvelopeError, MalformedEnvelopeError
from eskin.wire.envelope import MOST_ENVELOPE, Opener, Sealer
from eskin.wire.envelope.header import Header, associated_data, read_iv, read_parts
from eskin.wire.envelope.opener import Parts, read_ordinary
from eskin.wire.messages import Position
from eskin.wire.messages.cbor_map import MOST_COUNT

if TYPE_CHECKING:
    from tests.support.identities import Identities

TOPIC = "eskin/v1/nodes/fingertip/blocks"
COUNTS = st.sampled_from([0, 23, 24, 255, 256, 65_535, 65_536, 2**32 - 1, 2**32, MOST_COUNT])


def generally(envelope: bytes) -> Parts | None:
    try:
        protected, unprotected, sealed = read_parts(envelope)
        return Parts(protected, Header.read(protected), read_iv(unprotected), sealed)
    except MalformedEnvelopeError:
        return None


@given(boot=COUNTS, sequence=COUNTS, size=st.sampled_from([240, 1100, 65_519]))
def test_ordinary_envelope_is_read_the_short_way(
    *, identities: Identities, boot: int, sequence: int, size: int
) -> None:
    sealer = Sealer(identities.node, identities.site.certificate)
    envelope = sealer.seal(bytes(size), topic=TOPIC, held=Position(boot, sequence))
    short = read_ordinary(envelope)
    assert short is not None
    assert short == generally(envelope)
    assert short.header.held == Position(boot, sequence)


@given(
    at=st.integers(0, 160) | st.integers(0, 2000),
    new=st.binary(max_size=3),
    removed=st.integers(0, 3),
)
def test_damaged_envelope_is_read_as_generally_or_not_at_all(
    *, identities: Identities, at: int, new: bytes, removed: int
) -> None:
    sealer = Sealer(identities.node, identities.site.certificate)
    whole = sealer.seal(bytes(300), topic=TOPIC, held=Position(1, 300))
    damaged = whole[:at] + new + whole[at + removed :]
    short = read_ordinary(damaged)
    assert short is None or short == generally(damaged)
    known = {identities.node.thumbprint: identities.node.certificate}
    opener = Opener([identities.site], sender=known.get)
    if damaged != whole:
        with pytest.raises(EnvelopeError):
            opener.open(damaged, topic=TOPIC)


@pytest.mark.parametrize("held", [[1], [-1, 2], [1, MOST_COUNT + 1], [1, 2, 3], None])
def test_header_that_is_not_as_most_are_is_left_to_the_general_way(
    identities: Identities, held: list[int] | None
) -> None:
    sealer = Sealer(identities.node, identities.site.certificate)
    parts = read_parts(sealer.seal(bytes(300), topic=TOPIC, held=Position(1, 2)))
    header = cbor2.loads(parts[0])
    header[-70_001] = held
    protected = cbor2.dumps(header)
    envelope = cbor2.dumps(cbor2.CBORTag(16, [protected, parts[1], parts[2]]))
    assert read_ordinary(envelope) is None


def test_numbers_behind_bytes_that_look_like_held_are_not_held(identities: Identities) -> None:
    sealer = Sealer(identities.node, identities.site.certificate)
    parts = read_parts(sealer.seal(bytes(300), topic=TOPIC, held=Position(1, 2)))
    header = cbor2.loads(parts[0]) | {-99: [cbor2.dumps(-70_001) + b"\x82", 7, 8]}
    envelope = cbor2.dumps(cbor2.CBORTag(16, [cbor2.dumps(header), parts[1], parts[2]]))
    general = generally(envelope)
    assert general is not None
    assert general.header.held == Position(1, 2)
    assert read_ordinary(envelope) in (None, general)


def test_envelope_that_is_too_long_is_left_to_the_general_way(identities: Identities) -> None:
    sealer = Sealer(identities.node, identities.site.certificate)
    envelope = sealer.seal(bytes(65_500), topic=TOPIC, held=Position(1, 2))
    assert read_ordinary(envelope) is not None
    assert read_ordinary(envelope + bytes(MOST_ENVELOPE)) is None


@given(protected=st.binary(max_size=300), topic=st.text(max_size=80))
def test_associated_data_is_the_encoded_structure(*, protected: bytes, topic: str) -> None:
    expected = cbor2.dumps(["Encrypt0", protected, topic.encode()])
    assert associated_data(protected, topic) == expected
