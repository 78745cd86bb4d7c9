"""All that is held of a person, for readers with the scope, and for as long."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.access import Principal, digest, find_token, revoke_token, token_id
from eskin_cloud.api.dependencies import Access
from eskin_cloud.api.subjects import stream_lines
from eskin_cloud.privacy.key_access import RequestReader
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from sqlalchemy import select, update

from eskin.runtime.http_server.problems import ProblemError
from tests.support.identities import SITE
from tests.unit.cloud.sealing import NODE, Site, ask, declared, keyed, physician, pulse

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sqlalchemy import Connection

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


@pytest.fixture
def stand(tmp_path: Path, identities: Identities, site: Site) -> Iterator[Stand]:
    with keyed(tmp_path, identities, site) as made:
        yield made


async def test_export_of_a_subject_ends_when_its_token_is_revoked(stand: Stand, site: Site) -> None:
    await stand.ingest(site.batch(declared(), *(pulse(sequence) for sequence in range(1, 6))))
    store, token = stand.cloud.store, physician(stand)

    def holder() -> Principal | None:
        return find_token(store, token)

    first = holder()
    assert first is not None
    access = Access(first, "192.0.2.1", lambda: holder() is not None)
    reader = RequestReader(stand.cloud.key_access.require(first.scopes), access.opened)
    lines = stream_lines(stand.cloud, access, reader, SITE, site.ada.pseudonym)
    assert json.loads(next(lines))["sequence"] == 1
    assert revoke_token(store, token_id(digest(token)))
    with pytest.raises(ProblemError, match="revoked while it was used"):
        next(lines)


async def test_export_has_a_line_for_each_damaged_message(stand: Stand, site: Site) -> None:
    await stand.ingest(site.batch(declared(), *(pulse(sequence) for sequence in range(1, 4))))

    def damage(connection: Connection) -> None:
        v = sealed_messages.c
        row = connection.execute(select(v.cursor, v.data).where(v.sequence == 2)).one()
        worn = row.data[:-1] + bytes([row.data[-1] ^ 1])
        connection.execute(update(sealed_messages).where(v.cursor == row.cursor).values(data=worn))

    stand.cloud.store.write(damage).result(120)
    path = f"/api/v1/subjects/{site.ada.pseudonym}/export"
    lines = [
        json.loads(line) for line in (await ask(stand, physician(stand), path)).text.splitlines()
    ]
    assert [line["sequence"] for line in lines] == [1, 2, 3]
    assert lines[1] == {"damaged": True, "node": NODE, "boot": 1, "sequence": 2}
    assert [line.get("kind") for line in lines] == ["frame", None, "frame"]
