"""Biometric data are stored only encrypted: in spool, log and dead letters."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import cbor2
import pytest
from eskin_gateway.ingest.biometric import WITHHELD
from eskin_gateway.spool.subject_assignments import SubjectAssignments

from eskin.errors import IdentityError
from eskin.identity import IdentityKind
from eskin.privacy import Decryptor, FileMasterKey, KeyStore, SealedMessage
from eskin.wire.messages import Position
from eskin.wire.topics import Stream, node_topic
from tests.unit.gateway.messages import EPOCH, block, peak, status
from tests.unit.gateway.test_validator import introduce
from tests.unit.gateway.wire_node import Seal

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.privacy import Subject
    from eskin.wire.messages import Block, Peak
    from tests.support.identities import Identities
    from tests.unit.gateway.in_memory import Inside

BIOMETRIC = "t05.bioelectric"
MARKED = "bio-t01.pressure"


def remains(folder: Path) -> bytes:
    """All bytes of all files."""
    return b"".join(path.read_bytes() for path in folder.rglob("*") if path.is_file())


def traces(message: Block | Peak) -> list[bytes]:
    """Pieces of a message's bytes that nothing else has."""
    data = message.encode()
    return [data[at : at + 24] for at in range(len(data) // 2, len(data) - 24, 24)]


@pytest.mark.parametrize("channel", [BIOMETRIC, MARKED])
def test_biometric_block_and_peak_are_stored_encrypted(
    inside: Inside, seal: Seal, tmp_path: Path, channel: str
) -> None:
    introduce(inside, seal)
    told: list[Block | Peak] = [block(1, channel=channel), peak(2, channel=channel)]
    inside.arrive(Stream.BLOCKS, seal("fingertip", Stream.BLOCKS, told[0].encode()))
    inside.arrive(Stream.EVENTS, seal("fingertip", Stream.EVENTS, told[1].encode()))
    reader = Decryptor(inside.keystore)
    for message, body in zip(told, inside.stored()[1:], strict=True):
        assert reader.read("fingertip", SealedMessage.decode(body))[1] == message.encode()
        for trace in traces(message):
            assert trace not in remains(tmp_path)
    plain = block(3)
    inside.arrive(Stream.BLOCKS, seal("fingertip", Stream.BLOCKS, plain.encode()))
    assert inside.stored()[3] == plain.encode()
    assert traces(plain)[0] in remains(tmp_path)


def test_biometric_dead_letter_is_encrypted_and_not_logged(
    inside: Inside, seal: Seal, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    introduce(inside, seal)
    secret = 0.123456789
    poison = cbor2.dumps({1: 2, 2: 1, 3: 1, 4: BIOMETRIC, 5: "V", 11: [secret, "x"], 12: secret})
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
    inside.arrive(Stream.BLOCKS, seal("fingertip", Stream.BLOCKS, forged(subject.pseudonym)))
    assert inside.rejected() == {"unreadable": 1}


def forged(subject: str) -> bytes:
    return SealedMessage.decode(
        cbor2.dumps(
            {1: 6, 2: 1, 3: 1, 4: BIOMETRIC, 5: 1, 6: subject, 7: [0, 0], 8: bytes(16), 9: 0}
            | {10: bytes(16), 11: bytes(8)}
        )
    ).encode()


@pytest.fixture
def site(tmp_path: Path) -> KeyStore:
    return KeyStore(tmp_path / "keys", FileMasterKey(tmp_path / "master.key"))


@pytest.mark.parametrize(
    "said",
    [block(1, channel=BIOMETRIC).encode(), cbor2.dumps({1: 1, 2: 1, 3: 1, 4: BIOMETRIC})],
    ids=["block", "poison"],
)
def test_missing_key_rejects_messages_of_one_node_only(
    inside: Inside, seal: Seal, identities: Identities, said: bytes
) -> None:
    introduce(inside, seal)
    palm = Seal(identities.make(IdentityKind.NODE, "palm"), identities.site)
    introduction = palm("palm", Stream.STATUS, status(0).encode(), introduce=True)
    inside.arrive(Stream.STATUS, introduction, node="palm")
    inside.assignments.subject("fingertip", EPOCH)
    file = inside.keystore.directory / "nodes" / "fingertip"
    good = file.read_bytes()
    file.write_bytes(b"no list")

    def come() -> None:
        inside.broker.published.clear()
        inside.commit_loop.process(
            [
                inside.received_message(Stream.BLOCKS, seal("fingertip", Stream.BLOCKS, said)),
                inside.received_message(
                    Stream.BLOCKS, palm("palm", Stream.BLOCKS, block(1).encode()), node="palm"
                ),
            ]
        )

    come()
    assert inside.rejected() == {"internal_error": 1}
    assert inside.stored()[2:] == [block(1).encode()]
    assert len(inside.broker.on(node_topic("palm", Stream.ACKS))) == 1
    assert inside.broker.on(node_topic("fingertip", Stream.ACKS)) == []
    file.write_bytes(good)
    come()
    assert len(inside.broker.on(node_topic("fingertip", Stream.ACKS))) == 1
    assert len(inside.stored()) - 3 + len(inside.spool.dead_letters()) == 1


def test_subject_is_the_wearer_at_the_time_of_measurement(site: KeyStore) -> None:
    kept = SubjectAssignments(site)
    nobody = kept.subject("hand", 5)
    ada, bo = site.create("Ada"), site.create("Bo")
    kept.assign("hand", ada, since=10)
    kept.assign("hand", bo, since=20)
    again = SubjectAssignments(KeyStore(site.directory, site._master))
    for reader in (kept, again):
        whose = [reader.subject("hand", moment) for moment in (9, 10, 19, 20, 10**18)]
        assert whose == [nobody, ada, ada, bo, bo]
    assert again.wearers() == {"hand": bo.pseudonym}
    assert kept.subject("palm", 0) != nobody


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
