"""A slow, full, unreachable or incompatible store is reported, and loses nothing."""

from __future__ import annotations

import asyncio
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from eskin_cloud.access import Scope, create_token
from eskin_cloud.store import postgres, sqlite, store
from eskin_cloud.store.location import writing_engine
from eskin_cloud.store.schema.tables import events, feed, versions
from eskin_cloud.store.version import VERSION
from sqlalchemy import delete, func, insert, select, text, update

from tests.unit.cloud.clouds import batch, count_frames, problem, put
from tests.unit.cloud.messages import CHANNEL, NODE, START, peak, stretch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from contextlib import AbstractContextManager

    import httpx
    from eskin_cloud.store.location import StoreLocation
    from sqlalchemy import URL, Connection

    from tests.support.postgresql import Cluster
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

SERIES: Final = f"/api/v1/series/{NODE}/{CHANNEL}"
LATER: Final = "start the program that made it"


@dataclass(frozen=True, slots=True)
class Bed:
    """A cloud, and what can be done to its store from outside."""

    stand: Stand
    cluster: Callable[[], Cluster]

    @property
    def location(self) -> StoreLocation:
        return self.stand.cloud.store.location

    @property
    def server(self) -> URL:
        assert not isinstance(self.location, Path)
        return self.location


@contextmanager
def elsewhere(place: StoreLocation) -> Iterator[Connection]:
    """A transaction of another program, which has the store for itself while it lasts."""
    engine = writing_engine(place)
    try:
        with engine.begin() as connection:
            yield connection
    finally:
        engine.dispose()


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A store whose writer waits for others as it always does, but not for so long."""
    monkeypatch.setattr(sqlite, "_BUSY_S", 0.3)
    change_option(monkeypatch, "_WRITER_OPTIONS", "lock_timeout=10s", "lock_timeout=300ms")


@pytest.fixture
def impatient_readers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A store whose readers do not wait for so long either; on a busy machine, one may fail so."""
    change_option(monkeypatch, "_READER_OPTIONS", "statement_timeout=60s", "statement_timeout=1s")


def change_option(monkeypatch: pytest.MonkeyPatch, name: str, long: str, short: str) -> None:
    """Have connections to a server that are opened from now on wait for less long."""
    options = getattr(postgres, name)
    assert long in options
    monkeypatch.setattr(postgres, name, options.replace(long, short))


@pytest.fixture
def bed(request: pytest.FixtureRequest, impatient: None, stand: Stand) -> Bed:
    """A cloud on either store."""
    del impatient  # was in force when the store was opened
    return Bed(stand, lambda: request.getfixturevalue("cluster"))


def brought(first: int) -> bytes:
    """A batch of 100 kB."""
    lo, width = np.random.default_rng(first).random((2, 900))
    frames = (stretch(n, lo, lo + width) for n in range(first, first + 20))
    return batch(*frames, peak(first + 20))


def results(answer: httpx.Response) -> list[str]:
    """What became of each item of a batch."""
    assert answer.status_code == 200, answer.text
    return [item["result"] for item in answer.json()["items"]]


def held(stand: Stand) -> tuple[int, int]:
    """Frames and events that are stored."""
    with stand.cloud.store.read() as connection:
        stated = connection.execute(select(func.count()).select_from(events)).scalar_one()
    return count_frames(stand), stated


@contextmanager
def slow(bed: Bed) -> Iterator[str]:
    """Another program holds the write lock."""
    with elsewhere(bed.location) as connection:
        connection.execute(update(feed).values(cursor=feed.c.cursor))
        yield "has locked the file" if isinstance(bed.location, Path) else "is too slow"


@contextmanager
def full(bed: Bed) -> Iterator[str]:
    """The disk is full."""
    if isinstance(bed.location, Path):
        write = bed.stand.cloud.store.write_and_wait
        pages = write(lambda c: c.execute(text("PRAGMA page_count")).scalar_one())
        write(lambda c: c.execute(text(f"PRAGMA max_page_count={pages}")).all())
        yield "is full: free space"
        write(lambda c: c.execute(text("PRAGMA max_page_count=1000000")).all())
        return
    refusal = "BEGIN RAISE EXCEPTION 'could not extend file' USING ERRCODE = '53100'; END"
    with elsewhere(bed.location) as connection:
        connection.execute(
            text(f"CREATE FUNCTION refuse() RETURNS trigger LANGUAGE plpgsql AS $$ {refusal} $$")
        )
        connection.execute(
            text("CREATE TRIGGER refuse BEFORE UPDATE ON feed EXECUTE FUNCTION refuse()")
        )
    try:
        yield "disk is full; free space"
    finally:
        with elsewhere(bed.location) as connection:
            connection.execute(text("DROP FUNCTION refuse CASCADE"))


@contextmanager
def later(bed: Bed) -> Iterator[str]:
    """A program of another version has made the store."""
    version = VERSION + 1
    with elsewhere(bed.location) as connection:
        connection.execute(insert(versions), {"version": version, "applied": START})
    try:
        yield f"the store has schema version {version}, this program knows"
    finally:
        with elsewhere(bed.location) as connection:
            connection.execute(delete(versions).where(versions.c.version == version))


@contextmanager
def away(bed: Bed) -> Iterator[str]:
    """The server admits no connection."""
    bed.cluster().shut(bed.server)
    try:
        yield "start it, or correct store.url; then retry"
    finally:
        bed.cluster().admit(bed.server)


@pytest.mark.parametrize("fault", [slow, full, later])
async def test_ingest_acknowledges_what_is_stored_and_loses_nothing(
    bed: Bed, fault: Callable[[Bed], AbstractContextManager[str]]
) -> None:
    await check_promises(bed, fault)


@pytest.mark.parametrize("place", ["postgresql"], indirect=True)
async def test_ingest_loses_nothing_while_the_server_is_away(bed: Bed) -> None:
    await check_promises(bed, away)


async def check_promises(bed: Bed, fault: Callable[[Bed], AbstractContextManager[str]]) -> None:
    """While there is a fault nothing is acknowledged; after it, all is stored, once."""
    stand = bed.stand
    bodies = [brought(first) for first in (0, 30, 60)]
    assert results(await stand.ingest(bodies[0])) == ["stored"] * 21
    with fault(bed) as remedy:
        for body in bodies[1:]:
            answer = await stand.ingest(body)
            assert remedy in problem(answer, 503)
            assert int(answer.headers["retry-after"]) > 0
    assert held(stand) == (20, 1)
    assert (await stand.get("/readyz")).json() == {"status": "ok"}
    assert results(await stand.ingest(bodies[0])) == ["duplicate"] * 21
    assert results(await stand.ingest(bodies[1])) == ["stored"] * 21
    assert results(await stand.ingest(bodies[2])) == ["stored"] * 21
    assert held(stand) == (60, 3)


async def test_what_is_stored_is_answered_while_nothing_can_be_written(bed: Bed) -> None:
    put(bed.stand.cloud.store, stretch(0))
    bed.stand.present(brought(30))
    for fault in (slow, full):
        with fault(bed):
            problem(await bed.stand.ingest(brought(30)), 503)
            assert (await bed.stand.get(SERIES)).json()["lo"] == [1.0]


@pytest.mark.parametrize("path", ["/api/v1/nodes", SERIES, "/api/v1/events", "/readyz"])
async def test_store_of_another_version_is_neither_read_nor_ready(bed: Bed, path: str) -> None:
    put(bed.stand.cloud.store, stretch(0))
    with later(bed) as remedy:
        said = problem(await bed.stand.get(path), 503)
        assert remedy in said
        assert LATER in said
    assert (await bed.stand.get(path)).status_code == 200


@pytest.mark.usefixtures("impatient_readers")
@pytest.mark.parametrize("place", ["postgresql"], indirect=True)
async def test_reader_timeout_states_a_remedy(bed: Bed) -> None:
    put(bed.stand.cloud.store, stretch(0))
    with elsewhere(bed.location) as connection:
        connection.execute(text("LOCK TABLE pages IN ACCESS EXCLUSIVE MODE"))
        answer = await bed.stand.get(SERIES)
        assert "the server is too slow" in problem(answer, 503)
        assert int(answer.headers["retry-after"]) > 0
    async with asyncio.timeout(60):
        while (answer := await bed.stand.get(SERIES)).status_code == 503:
            pass
    assert answer.json()["lo"] == [1.0]


async def test_write_times_out(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = stand.cloud.store
    token = create_token(kept, scopes=[Scope.ADMIN], name="boss", lifetime=timedelta(hours=1))
    monkeypatch.setattr(store, "_WRITE_TIMEOUT_S", 0.2)
    with elsewhere(kept.location):
        kept._central.writer.fault = "it was slow before"
        assert "nothing was written for 0.2 s" in problem(await stand.get("/readyz"), 503)
        async with stand.client(token=token) as boss:
            desired_state = {"name": "lab", "scopes": ["read"]}
            answer = await boss.post("/api/v1/tokens", json=desired_state)
        assert "then retry" in problem(answer, 503)
    monkeypatch.undo()
    kept.check()
