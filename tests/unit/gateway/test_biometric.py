"""Biometric data are stored only encrypted: in spool, log and dead letters."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import cbor2
import numpy as np
import pytest
from eskin_gateway.ingest.biometric import WITHHELD
from eskin_gateway.spool.subject_assignments import SubjectAssignments

from eskin.errors import IdentityError
from eskin.identity import IdentityKind
from eskin.privacy import Decryptor, FileMasterKey, KeyStore, SealedMessage
from eskin.wire.messages import Kind, Position
from eskin.wire.topics import Stream, node_topic
from tests.unit.gateway.messages import EPOCH, frame
from tests.unit.gateway.skins import MIXED, TOUCHED, SkinOf
from tests.unit.gateway.test_validator import introduce
from tests.unit.gateway.wire_node import Seal

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.privacy import Subject
    from eskin.wire.frames import Frame, Statements
    from tests.support.identities import Identities
    from tests.unit.gateway.in_memory import Inside


def remains(folder: Path) -> bytes:
    """All bytes of all files."""
    return b"".join(path.read_bytes() for path in folder.rglob("*") if path.is_file())


def traces(message: Frame | Statements) -> list[bytes]:
    """Pieces of a message's bytes that nothing else has."""
    data = message.encode()
    return [data[at : at + 24] for at in range(len(data) // 2, len(data) - 24, 24)]


def noise(skin: SkinOf, sequence: int, page: int) -> Frame:
    """A frame whose bytes are most of them samples."""
    values = np.random.default_rng(1).integers(0, 1000, (200, 1)).astype(np.float64)
    return skin.frame(sequence, dict.fromkeys(range(2), values), page=page, rows=200)


def describe(inside: Inside, seal: Seal, skin: SkinOf) -> None:
    for each in skin.descriptions:
        inside.arrive(Stream.LAYOUTS, seal("fingertip", Stream.LAYOUTS, each))


@pytest.mark.parametrize("skin", [MIXED, TOUCHED])
def test_biometric_frame_and_statements_are_stored_encrypted(
    inside: Inside, seal: Seal, tmp_path: Path, skin: SkinOf
) -> None:
    introduce(inside, seal)
    describe(inside, seal, skin)
    stated: tuple[Frame | Statements, ...] = noise(skin, 1, page=1), skin.peaks(2, number=1)
    inside.arrive(Stream.FRAMES, seal("fingertip", Stream.FRAMES, stated[0].encode()))
    inside.arrive(Stream.EVENTS, seal("fingertip", Stream.EVENTS, stated[1].encode()))
    reader = Decryptor(inside.keystore)
    for message, body in zip(stated, inside.stored()[1:], strict=True):
        assert reader.read("fingertip", SealedMessage.decode(body))[1] == message.encode()
        assert traces(message)
        for trace in traces(message):
            assert trace not in remains(tmp_path)
    plain = noise(skin, 3, page=0)
    inside.arrive(Stream.FRAMES, seal("fingertip", Stream.FRAMES, plain.encode()))
    assert inside.stored()[3] == plain.encode()
    assert traces(plain)[0] in remains(tmp_path)


def test_biometric_dead_letter_is_encrypted_and_not_logged(
    inside: Inside, seal: Seal, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    introduce(inside, seal)
    secret = 0.123456789
    poison = cbor2.dumps(
        {1: int(Kind.STATEMENTS), 2: 1, 3: 1, 4: bytes(32), 5: [[0, 0, [secret, secret], "x"]]}
    )
    with caplog.at_level(logging.DEBUG):
        inside.arrive(Stream.EVENTS, seal("fingertip", Stream.EVENTS, poison))
    (letter,) = inside.spool.dead_letters()
    assert letter.reason == WITHHELD
    assert poison not in remains(tmp_path)
    assert str(secret) not in caplog.text
    assert WITHHELD in caplog.text
    opened = Decryptor(inside.keystore).decrypt("fingertip", SealedMessage.decode(letter.body))
    assert opened.endswith(b"\n" + poison)
    assert SealedMessage.decode(letter.body).position == Position(1, 1)


def test_sealed_message_from_a_node_is_rejected(inside: Inside, seal: Seal) -> None:
    introduce(inside, seal)
    subject = inside.assignments.subject("fingertip", EPOCH)
    inside.arrive(Stream.FRAMES, seal("fingertip", Stream.FRAMES, forged(subject.pseudonym)))
    assert inside.rejected() == {"unreadable": 1}


def forged(subject: str) -> bytes:
    return SealedMessage.decode(
        cbor2.dumps(
            {1: int(Kind.ENCRYPTED), 2: 1, 3: 1, 4: [bytes(32), 0], 5: int(Kind.FRAME)}
            | {6: subject, 7: [0, 0], 8: bytes(16), 9: 0, 10: bytes(16), 11: bytes(8)}
        )
    ).encode()


@pytest.fixture
def site(tmp_path: Path) -> KeyStore:
    return KeyStore(tmp_path / "keys", FileMasterKey(tmp_path / "master.key"))


@pytest.mark.parametrize(
    "said",
    [MIXED.frame(1, page=1).encode(), cbor2.dumps({1: int(Kind.FRAME), 2: 1, 3: 1, 4: bytes(32)})],
    ids=["frame", "poison"],
)
def test_missing_key_rejects_messages_of_one_node_only(
    inside: Inside, seal: Seal, identities: Identities, said: bytes
) -> None:
    introduce(inside, seal)
    palm = Seal(identities.make(IdentityKind.NODE, "palm"), identities.site)
    describe(inside, seal, MIXED)
    inside.introduce(palm, node="palm")
    inside.assignments.subject("fingertip", EPOCH)
    file = inside.keystore.directory / "nodes" / "fingertip"
    good = file.read_bytes()
    file.write_bytes(b"no list")

    def come() -> None:
        inside.broker.published.clear()
        inside.commit_loop.process(
            [
                inside.received_message(Stream.FRAMES, seal("fingertip", Stream.FRAMES, said)),
                inside.received_message(
                    Stream.FRAMES, palm("palm", Stream.FRAMES, frame(1).encode()), node="palm"
                ),
            ]
        )

    come()
    assert inside.rejected() == {"internal_error": 1}
    assert inside.stored()[2:] == [frame(1).encode()]
    assert len(inside.broker.on(node_topic("palm", Stream.ACKS))) == 1
    assert inside.broker.on(node_topic("fingertip", Stream.ACKS)) == []
    file.write_bytes(good)
    come()
    assert len(inside.broker.on(node_topic("fingertip", Stream.ACKS))) == 1
    assert len(inside.stored()) - 3 + len(inside.spool.dead_letters()) == 1


def test_subject_is_the_wearer_at_the_time_of_measurement(site: KeyStore) -> None:
    kept = SubjectAssignments(site)
    none = kept.subject("hand", 5)
    ada, bo = site.create("Ada"), site.create("Bo")
    kept.assign("hand", ada, since=10)
    kept.assign("hand", bo, since=20)
    again = SubjectAssignments(KeyStore(site.directory, site._master))
    for reader in (kept, again):
        whose = [reader.subject("hand", instant) for instant in (9, 10, 19, 20, 10**18)]
        assert whose == [none, ada, ada, bo, bo]
    assert again.wearers() == {"hand": bo.pseudonym}
    assert kept.subject("palm", 0) != none


def test_assignment_during_a_nodes_first_message_is_used(
    site: KeyStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway, command = SubjectAssignments(site), SubjectAssignments(site)
    ada, create = site.create("Ada"), site.create

    def meanwhile(name: str = "") -> Subject:
        monkeypatch.setattr(site, "create", create)
        command.assign("palm", ada, since=EPOCH)
        return create(name)

    monkeypatch.setattr(site, "create", meanwhile)
    assert gateway.subject("palm", EPOCH).pseudonym == ada.pseudonym
    assert command.wearers() == {"palm": ada.pseudonym}


def test_assignment_by_another_process_is_used_at_once(site: KeyStore) -> None:
    running, command = SubjectAssignments(site), SubjectAssignments(site)
    ada = site.create("Ada")
    assert running.subject("hand", 10**18) != ada
    command.assign("hand", ada, since=0)
    assert running.subject("hand", 10**18) == ada


def test_late_data_of_an_erased_subject_get_a_lost_key(site: KeyStore) -> None:
    kept = SubjectAssignments(site)
    ada = site.create("Ada")
    kept.assign("hand", ada, since=10)
    site.erase(ada.pseudonym)
    assert kept.release(ada.pseudonym, since=20) == ["hand"]
    late = kept.subject("hand", 15)
    assert late.pseudonym == ada.pseudonym
    assert late.key != ada.key
    assert late.key not in remains(site.directory)
    assert kept.subject("hand", 15) == late
    assert kept.subject("hand", 25).pseudonym not in {ada.pseudonym, late.pseudonym}


def test_name_of_a_node_is_no_path(site: KeyStore) -> None:
    with pytest.raises(IdentityError):
        SubjectAssignments(site).assign("../subjects/x", site.create(), since=0)
