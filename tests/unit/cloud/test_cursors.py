"""Cursors and stores: those of another store are refused, with the remedy, and nothing is lost."""

from __future__ import annotations

import asyncio
from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.access import Scope, create_token
from eskin_cloud.query.opaque_ids import OpaqueIds
from eskin_cloud.store import Store
from eskin_cloud.store.feed_entry import FEED_START
from eskin_cloud.store.location import writing_engine
from eskin_cloud.store.schema.tables import versions
from sqlalchemy import update

from eskin.errors import StoreError
from tests.support.websocket_closing import close_code
from tests.unit.cloud.clouds import Stand, batch, problem, put, standing
from tests.unit.cloud.commits import kinds
from tests.unit.cloud.frame_clients import PATIENCE_S, dial, serving
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from tests.support.identities import Identities

pytestmark = pytest.mark.anyio
SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"


@pytest.fixture
def stand(tmp_path: Path, identities: Identities) -> Iterator[Stand]:
    with encrypting(tmp_path, identities) as made:
        yield made


@pytest.fixture
def other(tmp_path: Path, identities: Identities) -> Iterator[Stand]:
    """A cloud on another store."""
    (tmp_path / "other").mkdir()
    with encrypting(tmp_path / "other", identities) as made:
        yield made


@contextmanager
def encrypting(folder: Path, identities: Identities) -> Iterator[Stand]:
    """A cloud whose cursors are encrypted, as outside of tests."""
    with standing(folder, identities) as made:
        made.cloud.feed.ids = OpaqueIds(made.cloud.store.cursor_key)
        yield made


def cursors(ids: OpaqueIds) -> dict[str, str]:
    """A cursor of each list, by its question."""
    name, number = ids.write_name("a"), ids.write(10**6)
    return {
        "/api/v1/nodes": name,
        f"/api/v1/nodes/{NODE}/channels": name,
        "/api/v1/monitors": name,
        "/api/v1/alarms": number,
        "/api/v1/audit-log": number,
        "/api/v1/events": ids.write(START, 1, 0),
        f"{SERIES}/threshold?above=1": ids.write(2 * START, START + 10**9),
        f"/api/v1/export?channel={NODE}/{CHANNEL}&limit=1": ids.write(START, START + 1, *[0] * 4),
    }


async def test_cursor_of_another_store_is_rejected_by_each_list(stand: Stand, other: Stand) -> None:
    await stand.ingest(batch(stretch(0)))
    foreign = cursors(other.cloud.feed.ids)
    scopes = (Scope.READ, Scope.ADMIN)
    token = create_token(stand.cloud.store, scopes=scopes, name="a", lifetime=timedelta(hours=1))
    async with stand.client(token=token) as client:
        for question, own in cursors(stand.cloud.feed.ids).items():
            asked = f"{question}{'&' if '?' in question else '?'}cursor="
            refused = await client.get(asked + foreign[question])
            assert "leave it out" in problem(refused, 422), question
            assert refused.json()["type"] == "/problems/unknown-cursor", question
            answer = await client.get(asked + own)
            assert answer.status_code == 200, (question, answer.text)


async def test_id_of_another_store_is_rejected_by_each_stream(stand: Stand, other: Stand) -> None:
    position = other.cloud.feed.ids.write_position(FEED_START)
    async with stand.client() as client, asyncio.timeout(PATIENCE_S):
        refused = await client.get("/api/v1/live", headers={"Last-Event-ID": position})
    assert "Last-Event-ID" in problem(refused, 422)
    assert refused.json()["type"] == "/problems/unknown-cursor"
    async with serving(stand) as port, dial(port, stand.token, cursor=position) as connection:
        assert await close_code(connection) == 4422


def test_store_that_was_replaced_is_neither_read_nor_written(place: StoreLocation) -> None:
    """As when another store is moved to where a cloud runs: its cursors count other messages."""
    engine = writing_engine(place)
    with Store(place) as store:
        put(store, stretch(0))
        with engine.begin() as connection:
            connection.execute(update(versions).values(cursor_key=bytes(32)))
        for attempt in (store.check, lambda: put(store, stretch(1))):
            with pytest.raises(StoreError, match="restart"):
                attempt()
        with Store(place) as later:
            assert kinds(put(later, stretch(0), stretch(1))) == ["duplicate", "stored"]
        with engine.begin() as connection:
            connection.execute(update(versions).values(cursor_key=store.cursor_key))
        assert kinds(put(store, stretch(1), stretch(2))) == ["duplicate", "stored"]
    engine.dispose()
