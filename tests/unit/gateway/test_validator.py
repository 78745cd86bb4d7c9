"""Invalid messages are rejected, counted and not acknowledged."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import cbor2
import pytest
from eskin_gateway.ingest.biometric import WITHHELD

from eskin.errors import SpoolError
from eskin.identity import IdentityKind, new_key
from eskin.privacy import Decryptor, SealedMessage
from eskin.wire.envelope import MOST_ENVELOPE, Opener
from eskin.wire.messages import Acknowledgement, Kind, Position
from eskin.wire.topics import Stream, node_topic
from tests.support.identities import SITE, Identities
from tests.unit.gateway.in_memory import Inside
from tests.unit.gateway.messages import frame, gap, peak, status
from tests.unit.gateway.wire_node import Seal

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin_gateway.spool.batch import DeadLetter

    from eskin.identity import Identity

ACKS = node_topic("fingertip", Stream.ACKS)


def introduce(inside: Inside, seal: Seal) -> None:
    inside.introduce(seal)


def present(inside: Inside, seal: Seal) -> None:
    """Say a first status only."""
    introduced = seal("fingertip", Stream.STATUS, status(0).encode(), introduce=True)
    inside.arrive(Stream.STATUS, introduced)


def acknowledged(inside: Inside, identities: Identities) -> set[tuple[int, int]]:
    opener = Opener([identities.node], sender=lambda _: identities.site.certificate)
    spans = [
        span
        for sealed in inside.broker.on(ACKS)
        for span in Acknowledgement.decode(opener.open(sealed, topic=ACKS).plaintext).spans
    ]
    return {(boot, n) for boot, first, last in spans for n in range(first, last + 1)}


def kept(inside: Inside, letter: DeadLetter) -> bytes:
    """Body of a dead letter; a biometric one is encrypted with its reason."""
    if letter.reason != WITHHELD:
        return letter.body
    opened = Decryptor(inside.keystore).decrypt(letter.node, SealedMessage.decode(letter.body))
    return opened.partition(b"\n")[2]


def flipped(envelope: bytes) -> bytes:
    return envelope[:-1] + bytes([envelope[-1] ^ 1])


BAD: dict[str, Callable[[Seal, Identities], bytes]] = {
    "malformed": lambda _seal, _ids: b"\xff\x00rubbish",
    "oversized": lambda _seal, _ids: bytes(MOST_ENVELOPE + 1),
    "forged": lambda seal, _ids: flipped(seal("fingertip", Stream.FRAMES, frame(1).encode())),
    "wrong_recipient": lambda _seal, ids: Seal(ids.node, ids.gateway)(
        "fingertip", Stream.FRAMES, frame(1).encode()
    ),
    "unknown_sender": lambda _seal, ids: Seal(ids.make(IdentityKind.NODE, "palm"), ids.site)(
        "fingertip", Stream.FRAMES, frame(1).encode()
    ),
}


@pytest.mark.parametrize("reason", BAD)
def test_invalid_message_is_rejected_and_released(
    inside: Inside, seal: Seal, identities: Identities, reason: str
) -> None:
    introduce(inside, seal)
    inside.arrive(Stream.FRAMES, BAD[reason](seal, identities))
    assert inside.rejected() == {reason: 1}
    assert inside.broker.released == [1, 2, 3, 4]
    assert acknowledged(inside, identities) == {(1, 0)}
    assert inside.stored() == [status(0).encode()]


def test_message_moved_to_another_topic_is_forged(inside: Inside, seal: Seal) -> None:
    introduce(inside, seal)
    inside.arrive(Stream.EVENTS, seal("fingertip", Stream.FRAMES, frame(1).encode()))
    assert inside.rejected() == {"forged": 1}


def test_other_nodes_message_is_misaddressed(
    inside: Inside, seal: Seal, identities: Identities
) -> None:
    introduce(inside, seal)
    inside.arrive(Stream.FRAMES, seal("palm", Stream.FRAMES, frame(1).encode()), node="palm")
    assert inside.rejected() == {"misaddressed": 1}
    assert inside.spool.node("palm") is None
    assert acknowledged(inside, identities) == {(1, 0)}


def test_topic_that_no_node_writes_is_rejected(inside: Inside, seal: Seal) -> None:
    introduce(inside, seal)
    inside.arrive(Stream.ACKS, seal("fingertip", Stream.ACKS, frame(1).encode()))
    assert inside.rejected() == {"topic": 1}


@pytest.fixture
def outsiders(tmp_path: Path) -> Identities:
    return Identities(tmp_path / "outsiders")


def test_certificate_of_other_ca_is_untrusted(
    inside: Inside, outsiders: Identities, identities: Identities
) -> None:
    present(inside, Seal(outsiders.node, identities.site))
    assert inside.rejected() == {"untrusted": 1}
    assert inside.stored() == []


def test_expired_certificate_is_untrusted(inside: Inside, identities: Identities) -> None:
    long_ago = datetime.now(UTC) - timedelta(days=3)
    key = new_key()
    chain = identities.authority.issue(
        IdentityKind.NODE,
        "fingertip",
        key.public_key(),
        site=SITE,
        now=long_ago,
        lifetime=timedelta(days=1),
    )
    expired = replace(identities.node, key=key, chain=chain)  # other tests share the folder
    present(inside, Seal(expired, identities.site))
    assert inside.rejected() == {"untrusted": 1}


@pytest.mark.parametrize(
    ("kind", "name"), [(IdentityKind.NODE, "palm"), (IdentityKind.CLIENT, "client.demo")]
)
def test_certificate_of_another_identity_is_untrusted(
    inside: Inside, identities: Identities, kind: IdentityKind, name: str
) -> None:
    other: Identity = identities.make(kind, name)
    present(inside, Seal(other, identities.site))
    assert inside.rejected() == {"untrusted": 1}
    assert inside.stored() == []


def test_certificate_that_expires_meanwhile_is_untrusted(inside: Inside, seal: Seal) -> None:
    introduce(inside, seal)
    inside.clock.wall += timedelta(days=400)
    inside.clock.seconds += 11.0
    inside.arrive(Stream.FRAMES, seal("fingertip", Stream.FRAMES, frame(1).encode()))
    assert inside.rejected() == {"untrusted": 1}


def test_retained_message_of_known_position_is_acknowledged_not_stored(
    inside: Inside, seal: Seal, identities: Identities
) -> None:
    introduce(inside, seal)
    introduce(inside, seal)
    assert inside.stored() == [status(0).encode()]
    assert inside.rejected() == {}
    assert len(inside.broker.on(ACKS)) == 2
    assert acknowledged(inside, identities) == {(1, 0)}


def test_position_below_held_is_never_stored(
    inside: Inside, seal: Seal, identities: Identities
) -> None:
    introduce(inside, seal)
    for number, held in ((7, Position(1, 7)), (3, None)):
        envelope = seal("fingertip", Stream.FRAMES, frame(number).encode(), held=held)
        inside.arrive(Stream.FRAMES, envelope)
    assert inside.stored() == [status(0).encode(), frame(7).encode()]
    assert acknowledged(inside, identities) == {(1, 0), (1, 3), (1, 7)}


def test_lower_boot_after_a_new_flash_is_accepted(
    inside: Inside, seal: Seal, identities: Identities
) -> None:
    ahead, now = 9000, 5400
    first = status(0, boot=ahead).encode()
    held = Position(ahead, 0)
    inside.arrive(Stream.STATUS, seal("fingertip", Stream.STATUS, first, held=held, introduce=True))
    inside.describe(seal)
    said = [frame(number, boot=now).encode() for number in (0, 2, 1)]
    for message in said:
        envelope = seal("fingertip", Stream.FRAMES, message, held=Position(now, 0))
        inside.arrive(Stream.FRAMES, envelope)
        inside.arrive(Stream.FRAMES, envelope)
    assert inside.stored() == [first, *said]
    assert acknowledged(inside, identities) == {(ahead, 0), (now, 0), (now, 1), (now, 2)}


def test_status_of_an_old_boot_is_not_published(inside: Inside, seal: Seal) -> None:
    """Only the cloud can detect duplicates of boots that the gateway dropped."""

    def say(boot: int) -> bytes:
        held = Position(boot, 0)
        message = status(0, boot=boot).encode()
        envelope = seal("fingertip", Stream.STATUS, message, held=held, introduce=True)
        inside.arrive(Stream.STATUS, envelope)
        return envelope

    old = say(4)
    for boot in range(5, 40):
        say(boot)
    state = inside.spool.node("fingertip")
    before = len(inside.broker.published)
    inside.arrive(Stream.STATUS, old)
    assert inside.stored()[-1] == status(0, boot=4).encode(), "the cloud will know it"
    after = inside.spool.node("fingertip")
    assert state is not None
    assert after is not None
    assert after.status == state.status
    assert [topic for topic, *_ in inside.broker.published[before:]] == [ACKS]


@pytest.mark.parametrize(
    ("stream", "plaintext", "position"),
    [
        (Stream.FRAMES, peak(1).encode(), (1, 1)),
        (Stream.EVENTS, frame(1).encode(), (1, 1)),
        (Stream.STATUS, gap(1).encode(), (1, 1)),
        (Stream.FRAMES, cbor2.dumps({1: int(Kind.PATCH), 2: 4, 3: 2}), (4, 2)),
        (Stream.FRAMES, cbor2.dumps({1: 99, 2: 4, 3: 2}), (4, 2)),
        (Stream.FRAMES, cbor2.dumps({3: 2, 1: int(Kind.FRAME), 2: 4}), (4, 2)),
        (Stream.FRAMES, cbor2.dumps({**cbor2.loads(frame(1).encode()), 14: [0.0, 1.0]}), (1, 1)),
        (Stream.FRAMES, b"no cbor at all", None),
        (Stream.FRAMES, cbor2.dumps([1, 2, 3]), None),
        (Stream.FRAMES, cbor2.dumps({1: int(Kind.FRAME), 2: -4, 3: "x"}), None),
    ],
)
def test_unreadable_message_becomes_one_dead_letter_and_is_acknowledged(
    inside: Inside,
    seal: Seal,
    identities: Identities,
    stream: Stream,
    plaintext: bytes,
    position: tuple[int, int] | None,
) -> None:
    introduce(inside, seal)
    for _ in range(2):
        inside.arrive(stream, seal("fingertip", stream, plaintext))
    (letter,) = inside.spool.dead_letters()
    assert (letter.node, kept(inside, letter)) == ("fingertip", plaintext)
    assert letter.reason
    assert inside.rejected()["unreadable"] >= 1
    expected = {(1, 0)} if position is None else {(1, 0), position}
    assert acknowledged(inside, identities) == expected
    assert inside.stored() == [status(0).encode()]


def test_revoked_node_is_rejected_at_once(tmp_path: Path) -> None:
    own = Identities(tmp_path / "own")
    crl = own.authority.write_revocations(IdentityKind.NODE)
    inside = Inside(tmp_path, own, revocations=crl)
    seal = Seal(own.node, own.site)
    introduce(inside, seal)
    assert inside.rejected() == {}
    own.authority.revoke("fingertip")
    inside.clock.seconds += 1.5
    inside.arrive(Stream.FRAMES, seal("fingertip", Stream.FRAMES, frame(1).encode()))
    assert inside.rejected() == {"untrusted": 1}
    palm = own.make(IdentityKind.NODE, "palm")
    envelope = Seal(palm, own.site)("palm", Stream.STATUS, status(0).encode(), introduce=True)
    inside.arrive(Stream.STATUS, envelope, node="palm")
    assert inside.rejected() == {"untrusted": 1}
    inside.spool.close()


def test_missing_or_forged_revocation_list_rejects_all_nodes(
    tmp_path: Path, identities: Identities
) -> None:
    crl = tmp_path / "node.crl.pem"
    inside = Inside(tmp_path, identities, revocations=crl)
    seal = Seal(identities.node, identities.site)
    present(inside, seal)
    assert inside.rejected() == {"untrusted": 1}
    assert "cannot be read" in str(inside.revocations.fault)
    outsiders = Identities(tmp_path / "outsiders")
    crl.write_bytes(outsiders.authority.write_revocations(IdentityKind.NODE).read_bytes())
    inside.clock.seconds += 1.5
    present(inside, seal)
    assert "not issued by our CA" in str(inside.revocations.fault)
    crl.write_bytes(identities.authority.write_revocations(IdentityKind.NODE).read_bytes())
    inside.clock.seconds += 1.5
    present(inside, seal)
    assert inside.rejected() == {"untrusted": 2}
    assert inside.revocations.fault is None
    inside.spool.close()


def test_unreadable_spool_is_an_internal_error(
    inside: Inside, seal: Seal, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreadable(_named: bytes) -> None:
        raise SpoolError("the disk is gone")

    monkeypatch.setattr(inside.spool, "certificate", unreadable)
    inside.arrive(Stream.FRAMES, seal("fingertip", Stream.FRAMES, frame(1).encode()))
    assert inside.rejected() == {"internal_error": 1}


def test_node_of_another_site_is_untrusted(inside: Inside, identities: Identities) -> None:
    for site in ("site.other", SITE):
        own = identities.make(IdentityKind.NODE, f"of-{site[5:]}", site=site)
        sealed = Seal(own, identities.site)(
            own.name, Stream.STATUS, status(0).encode(), introduce=True
        )
        inside.arrive(Stream.STATUS, sealed, node=own.name)
    assert inside.rejected() == {"untrusted": 1}
    assert len(inside.stored()) == 1
