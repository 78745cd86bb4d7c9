"""Signed messages are taken from the one signer who may sign, on the right topic, unaltered."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pycose.keys import EC2Key
from pycose.messages import Sign1Message

from eskin.errors import (
    EnvelopeError,
    ForgedEnvelopeError,
    IdentityError,
    MalformedEnvelopeError,
    UntrustedCertificateError,
)
from eskin.identity import ChainVerifier, Identity, IdentityKind
from eskin.identity.certificates import public_key
from eskin.wire.envelope import Verifier, sign

if TYPE_CHECKING:
    from tests.support.identities import Identities

TOPIC = "eskin/v1/nodes/fingertip/commands"


@pytest.fixture(scope="module")
def server(identities: Identities) -> Identity:
    return identities.make(IdentityKind.SERVER, "server.cloud")


@pytest.fixture(scope="module")
def verifier(identities: Identities) -> Verifier:
    trust = ChainVerifier(*identities.authority.roots)
    return Verifier(trust, kind=IdentityKind.SERVER, name="server.cloud")


def test_signed_message_is_taken(server: Identity, verifier: Verifier) -> None:
    assert verifier.verify(sign(b"do", own=server, topic=TOPIC), topic=TOPIC) == b"do"


def test_message_moved_to_another_topic_is_forged(server: Identity, verifier: Verifier) -> None:
    signed = sign(b"do", own=server, topic=TOPIC)
    with pytest.raises(ForgedEnvelopeError):
        verifier.verify(signed, topic="eskin/v1/nodes/palm/commands")


@given(at=st.integers(0, 10_000), bit=st.integers(0, 7))
def test_any_flipped_bit_is_refused(
    server: Identity, verifier: Verifier, at: int, bit: int
) -> None:
    signed = bytearray(sign(b"do", own=server, topic=TOPIC))
    signed[at % len(signed)] ^= 1 << bit
    with pytest.raises((EnvelopeError, IdentityError)):
        verifier.verify(bytes(signed), topic=TOPIC)


@given(data=st.binary(max_size=200))
def test_random_bytes_are_malformed(verifier: Verifier, data: bytes) -> None:
    with pytest.raises(MalformedEnvelopeError):
        verifier.verify(data, topic=TOPIC)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (IdentityKind.SERVER, "server.broker"),
        (IdentityKind.GATEWAY, "gateway.cloud"),
        (IdentityKind.NODE, "cloud"),
    ],
)
def test_no_other_may_sign(
    identities: Identities, verifier: Verifier, kind: IdentityKind, name: str
) -> None:
    other = identities.make(kind, name)
    with pytest.raises(UntrustedCertificateError):
        verifier.verify(sign(b"do", own=other, topic=TOPIC), topic=TOPIC)


def test_expired_signer_is_refused(identities: Identities, server: Identity) -> None:
    instant = datetime.now(UTC) + timedelta(days=4000)
    late = ChainVerifier(*identities.authority.roots, clock=lambda: instant)
    verifier = Verifier(late, kind=IdentityKind.SERVER, name="server.cloud")
    with pytest.raises(UntrustedCertificateError, match="valid from"):
        verifier.verify(sign(b"do", own=server, topic=TOPIC), topic=TOPIC)


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ({1: -8}, "ES256"),
        ({33: b"one"}, "x5chain"),
        ({33: ["text"]}, "x5chain"),
    ],
)
def test_other_headers_are_named(
    server: Identity, verifier: Verifier, header: dict[int, object], says: str
) -> None:
    protected, unprotected, plaintext, signature = cbor2.loads(
        sign(b"do", own=server, topic=TOPIC)
    ).value
    protected = cbor2.dumps(cbor2.loads(protected) | header)
    changed = cbor2.CBORTag(18, [protected, unprotected, plaintext, signature])
    with pytest.raises(MalformedEnvelopeError, match=says):
        verifier.verify(cbor2.dumps(changed), topic=TOPIC)


def test_independent_cose_library_agrees(server: Identity) -> None:
    message = Sign1Message.decode(sign(b"do", own=server, topic=TOPIC))
    numbers = public_key(server.certificate).public_numbers()
    message.key = EC2Key(crv="P_256", x=numbers.x.to_bytes(32), y=numbers.y.to_bytes(32))
    message.external_aad = TOPIC.encode()
    assert message.verify_signature()
    message.external_aad = b"elsewhere"
    assert not message.verify_signature()
