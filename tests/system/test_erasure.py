"""Erasing a person: what is left, in every file, is unreadable and leads to no person."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import logging
import time
from typing import TYPE_CHECKING, Any, Final

import cbor2
import pytest
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from eskin_cloud.store.write.audit_log import check_audit_entries, list_audit_entries
from eskin_gateway.ops.subject_sync import SubjectSync
from eskin_gateway.upstream.subjects_client import SubjectsClient
from sqlalchemy import select

from eskin.cli import app
from eskin.errors import CloudError, NoKeyError, SettingsError
from eskin.interval import Interval, Verdict
from eskin.privacy import Decryptor, SealedMessage
from eskin.wire.frames import (
    Frame,
    Grid,
    Layout,
    Patch,
    PatchSamples,
    Peak,
    Privacy,
    Statements,
)
from eskin.wire.messages import Position
from eskin.wire.topics import Stream
from tests.support.identities import SITE
from tests.unit.cloud.clouds import admit
from tests.unit.cloud.sealing import ask, physician, remains, sealing
from tests.unit.gateway.certificates import KnownNodes
from tests.unit.gateway.in_memory import Inside, quick
from tests.unit.gateway.test_validator import introduce
from tests.unit.gateway.wire_node import Seal

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    import httpx

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

NODE: Final = "fingertip"
NAME: Final = "Ada Lovelace"
CHANNEL: Final = "h0.bioelectric"
SERIES: Final = f"/api/v1/series/{NODE}/{CHANNEL}"
SKIN: Final = Patch("heart", "bioelectric", "V", ("h0",), 1e-3, Privacy.BIOMETRIC, "wearer")
LAYOUT: Final = Layout((SKIN.content_hash,), (1,))
STREAMS: Final = {
    Frame: Stream.FRAMES,
    Patch: Stream.LAYOUTS,
    Layout: Stream.LAYOUTS,
}
Message = Frame | Statements


class House(SubjectsClient):
    """A gateway and a cloud on real files, without a network between them."""

    def __init__(self, folder: Path, identities: Identities, stand: Stand) -> None:
        self.stand = stand
        self.inside = Inside(folder / "gateway", identities)
        self.seal = Seal(identities.node, identities.site)
        self.reachable = True
        self.subject_sync = SubjectSync(
            self.inside.keystore,
            self.inside.assignments,
            encryptor=self.inside.encryptor,
            subjects_client=self,
            certificates_client=KnownNodes(),
            share=True,
            backoff=quick(),
        )
        self.config = folder / "gateway.toml"
        self.config.write_text(
            f'[identity]\ndirectory = "{folder}"\nsite = "{folder}"\n'
            f'[spool]\npath = "{folder / "gateway" / "spool.db"}"\n'
        )
        introduce(self.inside, self.seal)
        admit(stand.cloud.store, NODE, "hand", "palm")
        self.say(SKIN, LAYOUT)
        self.post("descriptions", cbor2.dumps([[NODE, each.encode()] for each in (SKIN, LAYOUT)]))

    def post(self, path: str, body: bytes) -> Any:
        async def posted() -> httpx.Response:
            async with self.stand.ingest_client() as client:
                return await client.post(f"/api/v1/{path}", content=body)

        answer = asyncio.run(posted())
        assert answer.status_code == 200, answer.text
        return answer.json()["items"]

    def send(
        self, worn: Sequence[tuple[str, str, bytes | None]], erased: Sequence[str]
    ) -> dict[str, str]:
        if not self.reachable:
            raise CloudError("unplugged")
        body = cbor2.dumps({"worn": [list(one) for one in worn], "erased": list(erased)})
        return {item["id"]: item["result"] for item in self.post("subjects", body)}

    def say(self, *messages: Message | Patch | Layout) -> None:
        for message in messages:
            stream = STREAMS.get(type(message), Stream.EVENTS)
            self.inside.arrive(stream, self.seal(NODE, stream, message.encode()))

    def forward(self) -> None:
        stored = self.inside.spool.take(1000, 10**9)
        items = self.post("ingest", cbor2.dumps([[m.node, m.body] for m in stored]))
        assert {item["result"] for item in items} == {"stored"}
        self.inside.spool.settle(stored)

    def command(self, *words: str) -> None:
        assert not app(["subjects", *words, "--config", str(self.config)], standalone_mode=False)

    def ask(self, path: str, **params: Any) -> Any:
        return asyncio.run(ask(self.stand, physician(self.stand), path, **params))

    def audit_entries(self) -> list[tuple[str, str, str]]:
        with self.stand.cloud.store.read() as connection:
            assert check_audit_entries(connection) is None
            rows, _ = list_audit_entries(connection, before=None, limit=100)
        said = [(row["action"], row["target"], row["detail"]) for row in reversed(rows)]
        return [audit_entry for audit_entry in said if audit_entry[0].startswith("subject")]


@pytest.fixture
def house(tmp_path: Path, identities: Identities) -> Iterator[House]:
    (tmp_path / "gateway").mkdir()
    with sealing(tmp_path / "cloud", identities) as stand:
        made = House(tmp_path, identities, stand)
        yield made
        made.inside.spool.close()


def heart(first: int) -> list[Message]:
    """Two frames and a peak of a heart, now."""
    now = time.time_ns()
    lo = [0.7071 + 0.001 * k * first for k in range(60)]
    return [beats(first, now, lo), beats(first + 1, now + 10**9, lo), peak(first + 2, now)]


def beats(number: int, now: int, lo: list[float]) -> Frame:
    grid = Grid(0, 1_000_000, 0, len(lo), 1.0)
    values = Interval([[low] for low in lo], [[low + 0.0123 * (k + 1)] for k, low in enumerate(lo)])
    samples = PatchSamples.pack(values, 1e-3, patch=0, grid=0, first_row=0)
    time_ = now, now + 5
    position = Position(1, number)
    return Frame(position, LAYOUT.content_hash, 0, now % 10**12, time_, (grid,), (samples,))


def peak(number: int, now: int) -> Statements:
    time_ = now, now + 5
    height = 0.4321 * number, 1e3
    stated = Peak(0, 0, time_, Verdict.CERTAIN, (1, 1), height, (0.123456, 0.2), 0.999)
    return Statements(Position(1, number), LAYOUT.content_hash, (stated,))


def pieces(message: Message) -> list[bytes]:
    """Pieces of a message that say something of the person; none of the layout's hash."""
    data = message.encode()
    return [data[at : at + 16] for at in range(max(len(data) // 3, 48), len(data) - 16, 16)]


def test_erased_person_is_unreadable_and_unlinkable_in_every_file(
    house: House, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    house.command("assign", "--node", NODE, "--name", NAME)
    house.subject_sync.sync()
    reported = heart(1)
    house.say(*reported)
    house.forward()
    waiting = heart(4)
    house.say(*waiting)
    (ada,) = house.inside.keystore.named(NAME)
    assert house.ask(SERIES).json()["resolution"] == "sample"
    assert house.ask(f"/api/v1/subjects/{ada.pseudonym}/export").text.count("\n") == 3

    house.command("erase", "--name", NAME)
    house.subject_sync.sync()
    house.forward()  # what waited in the spool was sealed already
    assert house.ask(SERIES).status_code == 410
    assert house.ask(f"/api/v1/subjects/{ada.pseudonym}/export").status_code == 404
    events = house.ask("/api/v1/events", channel=CHANNEL)
    assert events.json()["items"] == []

    held = remains(tmp_path) + caplog.text.encode()
    for secret in (ada.key, ada.salt, NAME.encode(), b"Lovelace", ada.key.hex().encode()):
        assert secret not in held
    for message in reported + waiting:
        assert all(piece not in held for piece in pieces(message))
    assert [
        audit_entry for audit_entry in house.audit_entries() if ada.pseudonym in audit_entry
    ] == [
        ("subject assigned", NODE, ada.pseudonym),
        ("subject exported", ada.pseudonym, SITE),
        ("subject erased", ada.pseudonym, SITE),
    ]


def test_nothing_that_is_left_opens_what_was_sealed_or_names_the_person(house: House) -> None:
    house.command("assign", "--node", NODE, "--name", NAME)
    house.subject_sync.sync()
    house.say(*heart(1))
    house.forward()
    (ada,) = house.inside.keystore.named(NAME)
    house.command("erase", "--pseudonym", ada.pseudonym)
    house.subject_sync.sync()
    house.command("assign", "--node", NODE, "--name", NAME)
    (again,) = house.inside.keystore.named(NAME)
    assert again.pseudonym != ada.pseudonym
    assert not {again.key, again.salt} & {ada.key, ada.salt}

    keystore = house.inside.keystore
    secret = keystore._master.unwrap((keystore.directory / "secret").read_bytes(), b"secret")
    kept = remains(keystore.directory)
    for salt in {b"", again.salt, *(kept[at : at + 16] for at in range(len(kept)))}:
        guess = hmac.digest(secret, salt + NAME.encode(), hashlib.sha256)
        assert guess[:16].hex() != ada.pseudonym

    own = house.stand.cloud.key_access.of(SITE)
    with house.stand.cloud.store.read() as connection:
        rows = connection.execute(select(sealed_messages.c.data)).scalars().all()
    assert len(rows) == 3
    for store in (keystore, own):
        for data in rows:
            with pytest.raises(NoKeyError, match="destroyed"):
                Decryptor(store).decrypt(NODE, SealedMessage.decode(data))


def test_erasure_waits_for_the_cloud_and_is_sent_again_until_it_confirms(house: House) -> None:
    house.command("assign", "--node", NODE, "--name", NAME)
    house.subject_sync.sync()
    (ada,) = house.inside.keystore.named(NAME)
    own = house.stand.cloud.key_access.of(SITE)
    assert own.find(ada.pseudonym).key == ada.key
    assert own.find(ada.pseudonym).name == ""
    house.reachable = False
    house.command("erase", "--name", NAME)
    with pytest.raises(CloudError):
        house.subject_sync.sync()
    (tombstone,) = house.inside.keystore.tombstones()
    assert tombstone.confirmed is None
    assert house.subject_sync.pending == 1
    house.reachable = True
    house.subject_sync.sync()
    assert house.subject_sync.pending == 0
    (tombstone,) = house.inside.keystore.tombstones()
    assert tombstone.confirmed is not None
    with pytest.raises(NoKeyError):
        own.find(ada.pseudonym)
    # A late notice, such as another gateway's, brings it back nowhere.
    assert house.send([(ada.pseudonym, NODE, ada.key)], []) == {ada.pseudonym: "erased"}
    with pytest.raises(NoKeyError):
        own.find(ada.pseudonym)


def test_node_whose_id_holds_the_name_is_not_assigned(house: House) -> None:
    with pytest.raises(SettingsError, match="holds part of the name"):
        house.command("assign", "--node", "lovelace-hand", "--name", NAME)
