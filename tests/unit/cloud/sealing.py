"""Sealed messages, a cloud that holds their keys, and people who may or may not read them."""

from __future__ import annotations

from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final

import cbor2
from eskin_cloud.access import Scope, create_token
from eskin_cloud.store.schema.tables import metadata
from sqlalchemy import select

from eskin.privacy import Encryptor, FileMasterKey, KeyStore
from eskin.runtime.settings import KeysSection
from eskin.wire.frames import EncodedFrame, Frame
from eskin.wire.messages import Status
from tests.support.identities import SITE
from tests.unit.cloud.clouds import Stand, admit, standing
from tests.unit.cloud.messages import peak, status, stretch

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import httpx
    from eskin_cloud.store import Store
    from eskin_cloud.store.location import StoreLocation

    from eskin.privacy import Subject
    from eskin.wire.frames import Statements
    from tests.support.identities import Identities

    Sealed = Frame | Statements

NODE: Final = "hand"
CHANNEL: Final = "t05.bioelectric"


class Site:
    """A gateway's key store, and what it brings."""

    def __init__(self, folder: Path) -> None:
        self.keystore = KeyStore(folder / "site", FileMasterKey(folder / "site.key"))
        self.ada = self.keystore.create("Ada Lovelace")
        self._encryptor = Encryptor()

    def seal(self, message: Sealed, subject: Subject | None = None) -> bytes:
        """A sealed message of the node."""
        data = message.encode()
        said = EncodedFrame.decode(data) if isinstance(message, Frame) else message
        return self._encryptor.encrypt(subject or self.ada, NODE, said, data).encode()

    def batch(self, *messages: Sealed | Status, subject: Subject | None = None) -> bytes:
        """The body of an ingest, in which all but statuses are sealed."""
        bodies = [
            said.encode() if isinstance(said, Status) else self.seal(said, subject)
            for said in messages
        ]
        return cbor2.dumps([[NODE, body] for body in bodies])


def remains(folder: Path) -> bytes:
    """All bytes of all files below a folder, and their names."""
    return b"".join(
        str(path).encode() + path.read_bytes() for path in folder.rglob("*") if path.is_file()
    )


def kept(store: Store) -> bytes:
    """All that any row of any table holds."""
    with store.read() as connection:
        tables = [connection.execute(select(table)).all() for table in metadata.sorted_tables]
    values = (value for rows in tables for row in rows for value in row)
    return b"".join(v if isinstance(v, bytes) else str(v).encode() for v in values)


def pulse(sequence: int, *bounds: Any, **given: Any) -> Frame:
    """A frame of the biometric channel."""
    return stretch(sequence, *bounds, **({"channel": CHANNEL, "unit": "V"} | given))


def beat(sequence: int, **given: Any) -> Statements:
    """A peak of the biometric channel."""
    return peak(sequence, **({"channel": CHANNEL, "unit": "V"} | given))


def declared(sequence: int = 0) -> Status:
    """The node's status."""
    return status(sequence)


@contextmanager
def sealing(
    folder: Path, identities: Identities, *, keys: bool = True, **sections: Any
) -> Iterator[Stand]:
    """A cloud in a folder that may hold keys."""
    own = KeysSection(directory=folder / "cloud-keys" if keys else None)
    with standing(folder, identities, keys=own, **sections) as stand:
        yield stand


@contextmanager
def keyed(
    folder: Path, identities: Identities, site: Site, *, place: StoreLocation | None = None
) -> Iterator[Stand]:
    """A cloud that was given the key of a site's person."""
    with sealing(folder, identities, place=place) as stand:
        stand.cloud.key_access.of(SITE).keep(site.ada.pseudonym, site.ada.key)
        yield stand


async def notice(stand: Stand, worn: list[Any], erased: list[str]) -> list[str]:
    """Tell a cloud who wears what and who is erased, as a gateway does; what became of each."""
    admit(stand.cloud.store, *(node for _, node, _ in worn))
    body = cbor2.dumps({"worn": worn, "erased": erased})
    async with stand.ingest_client() as client:
        answer = await client.post("/api/v1/subjects", content=body)
    assert answer.status_code == 200, answer.text
    return [item["result"] for item in answer.json()["items"]]


def physician(stand: Stand) -> str:
    """A token that may read what identifies a person."""
    scopes = [Scope.READ, Scope.BIOMETRIC]
    return create_token(
        stand.cloud.store, scopes=scopes, name="physician", lifetime=timedelta(hours=1)
    )


async def ask(stand: Stand, token: str, path: str, **params: Any) -> httpx.Response:
    """Ask with a token."""
    async with stand.client(token=token) as client:
        return await client.get(path, params=params)
