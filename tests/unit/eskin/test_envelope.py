"""Sealed messages open for the right reader, on the right topic, unaltered; and never otherwise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pycose.keys.symmetric import SymmetricKey
from pycose.messages.enc0message import Enc0Message

from eskin.errors import (
    EnvelopeError,
    ForgedEnvelopeError,
    MalformedEnvelopeError,
    UnknownRecipientError,
    UnknownSenderError,
)
from eskin.identity import IdentityKind, der
from eskin.wire.envelope import HELD, Opener, Sealer, introduction
from eskin.wire.envelope.encrypt0 import agree_key
from eskin.wire.messages import Position

if TYPE_CHECKING:
    from tests.support.identities import Identities

TOPIC = "eskin/v1/nodes/fingertip/blocks"


@pytest.fixture
def sealer(identities: Identities) -> Sealer:
    return Sealer(identities.node, identities.site.certificate)


@pytest.fixture
def opener(identities: Identities) -> Opener:
    known = {identities.node.thumbprint: identities.node.certificate}
    return Opener([identities.site], sender=known.get)


def test_opens_what_was_sealed_with_sender_and_held(sealer: Sealer, opener: Opener) -> None:
    envelope = sealer.seal(b"hello", topic=TOPIC, held=Position(3, 14))
    opened = opener.open(envelope, topic=TOPIC)
    assert (opened.plaintext, opened.sender) == (b"hello", "fingertip")
    assert opened.held == Position(3, 14)


def test_moved_to_another_topic_is_forged(sealer: Sealer, opener: Opener) -> None:
    envelope = sealer.seal(b"hello", topic=TOPIC)
    with pytest.raises(ForgedEnvelopeError):
        opener.open(envelope, topic="eskin/v1/nodes/palm/blocks")


@given(at=st.integers(0, 10_000), bit=st.integers(0, 7))
def test_any_flipped_bit_is_refused(identities: Identities, at: int, bit: int) -> None:
    known = {identities.node.thumbprint: identities.node.certificate}
    opener = Opener([identities.site], sender=known.get)
    sealer = Sealer(identities.node, identities.site.certificate)
    envelope = bytearray(sealer.seal(b"hello", topic=TOPIC, held=Position(0, 1)))
    envelope[at % len(envelope)] ^= 1 << bit
    with pytest.raises(EnvelopeError):
        opener.open(bytes(envelope), topic=TOPIC)


@given(data=st.binary(max_size=200))
def test_random_bytes_are_malformed(identities: Identities, data: bytes) -> None:
    opener = Opener([identities.site], sender=lambda _: None)
    with pytest.raises(MalformedEnvelopeError):
        opener.open(data, topic=TOPIC)


def test_unknown_sender_is_named_by_thumbprint(identities: Identities, sealer: Sealer) -> None:
    opener = Opener([identities.site], sender=lambda _: None)
    with pytest.raises(UnknownSenderError) as caught:
        opener.open(sealer.seal(b"x", topic=TOPIC), topic=TOPIC)
    assert caught.value.thumbprint == identities.node.thumbprint


def test_sealed_to_another_site_is_refused(identities: Identities, opener: Opener) -> None:
    elsewhere = identities.make(IdentityKind.SITE, "site.elsewhere")
    sealer = Sealer(identities.node, elsewhere.certificate)
    with pytest.raises(UnknownRecipientError):
        opener.open(sealer.seal(b"x", topic=TOPIC), topic=TOPIC)


def test_other_node_cannot_speak_for_this_one(identities: Identities, opener: Opener) -> None:
    palm = identities.make(IdentityKind.NODE, "palm")
    forger = Sealer(palm, identities.site.certificate)
    forger._header[-27] = [-16, identities.node.thumbprint]
    with pytest.raises(ForgedEnvelopeError):
        opener.open(forger.seal(b"x", topic=TOPIC), topic=TOPIC)


def test_answer_cannot_be_reflected_to_its_sender(identities: Identities) -> None:
    site = Sealer(identities.site, identities.node.certificate)
    envelope = site.seal(b"ack", topic=TOPIC)
    known = {identities.site.thumbprint: identities.site.certificate}
    reflected = Opener([identities.site], sender=known.get)
    with pytest.raises(UnknownRecipientError):
        reflected.open(envelope, topic=TOPIC)


def test_nonces_and_salts_never_repeat(identities: Identities) -> None:
    seen = set()
    for _ in range(3):
        sealer = Sealer(identities.node, identities.site.certificate)
        for _ in range(5):
            protected, unprotected, _ = cbor2.loads(sealer.seal(b"x", topic=TOPIC)).value
            seen.add((cbor2.loads(protected)[-20], unprotected[5]))
    assert len(seen) == 15
    assert len({salt for salt, _ in seen}) == 3


def test_introduction_carries_the_chain(identities: Identities, sealer: Sealer) -> None:
    assert introduction(sealer.seal(b"x", topic=TOPIC)) is None
    chain = introduction(sealer.seal(b"x", topic=TOPIC, introduce=True))
    assert chain == tuple(der(certificate) for certificate in identities.node.chain)


def test_forged_salts_push_no_sender_out(identities: Identities, sealer: Sealer) -> None:
    known = {identities.node.thumbprint: identities.node.certificate}
    opener = Opener([identities.site], sender=known.get, capacity=2)
    opener.open(sealer.seal(b"x", topic=TOPIC), topic=TOPIC)
    for _ in range(5):
        forged = Sealer(identities.node, identities.site.certificate).seal(b"x", topic="other")
        with pytest.raises(ForgedEnvelopeError):
            opener.open(forged, topic=TOPIC)
    assert len(opener._senders) == 1


def test_independent_cose_library_decrypts(identities: Identities, sealer: Sealer) -> None:
    envelope = sealer.seal(b"hello", topic=TOPIC, held=Position(1, 2))
    message = Enc0Message.decode(envelope)
    salt = cbor2.loads(cbor2.loads(envelope).value[0])[-20]
    node, site = identities.node.certificate, identities.site.certificate
    message.key = SymmetricKey(k=agree_key(identities.site.key, node, node, site, salt))
    message.external_aad = TOPIC.encode()
    assert message.decrypt() == b"hello"
    assert HELD in {getattr(label, "identifier", label) for label in message.phdr}
