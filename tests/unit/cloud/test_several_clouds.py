"""Several clouds on one store, each with its own key store: an erasure counts at all of them."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.access import Scope
from eskin_cloud.jobs import erasure
from eskin_cloud.live.feed import read_entries
from eskin_cloud.privacy import key_access
from eskin_cloud.service import make_cloud
from eskin_cloud.store import Store
from eskin_cloud.store.feed_entry import FEED_START

from eskin.errors import NoKeyError, PrivacyError, StoreError
from eskin.runtime.settings import KeysSection
from eskin.wire.timestamp import SECOND
from tests.support.identities import SITE
from tests.unit.cloud.clouds import Stand, problem
from tests.unit.cloud.messages import START
from tests.unit.cloud.sealing import (
    CHANNEL,
    NODE,
    Site,
    ask,
    beat,
    declared,
    notice,
    physician,
    pulse,
    sealing,
)
from tests.unit.cloud.streams import entry_reader

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_cloud.store.feed_entry import FeedEntry
    from eskin_cloud.store.location import StoreLocation

    from eskin.privacy import KeyStore
    from tests.support.identities import Identities

pytestmark = pytest.mark.anyio
SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"
WIDE = {"start": START - SECOND, "end": START + 3600 * SECOND}
ALLOWED = [Scope.READ, Scope.BIOMETRIC]


@pytest.fixture
def first(tmp_path: Path, identities: Identities, place: StoreLocation) -> Iterator[Stand]:
    with sealing(tmp_path, identities, place=place) as stand:
        yield stand


@pytest.fixture
def second(tmp_path: Path, first: Stand, place: StoreLocation) -> Iterator[Stand]:
    own = KeysSection(directory=tmp_path / "other-keys")
    settings = first.cloud.settings.model_copy(update={"keys": own})
    with Store(place, clock=first.clock) as store:
        cloud = make_cloud(settings, store, clock=first.clock, dashboard=tmp_path)
        yield Stand(cloud, first.clock, first.gateway, first.token)


def keys_of(stand: Stand) -> KeyStore:
    return stand.cloud.key_access.of(SITE)


async def wear(stand: Stand, site: Site) -> Any:
    return await notice(stand, [[site.ada.pseudonym, NODE, site.ada.key]], [])


def entries(stand: Stand) -> list[FeedEntry]:
    with stand.cloud.store.read() as connection:
        found = read_entries(connection, FEED_START.spans(stand.cloud.feed.last))
    return [entry for entry in found if entry.sealed is not None]


async def test_erasure_that_one_cloud_received_counts_at_all_of_them(
    first: Stand, second: Stand, site: Site
) -> None:
    token, ada = physician(first), site.ada.pseudonym
    assert await wear(first, site) == ["kept"]
    await first.ingest(site.batch(declared(), pulse(1), beat(2)))
    assert (await ask(first, token, SERIES, **WIDE)).status_code == 200
    assert len((await ask(first, token, f"/api/v1/subjects/{ada}/export")).text.splitlines()) == 2
    assert await notice(second, [], [ada]) == ["erased"]

    said = problem(await ask(first, token, SERIES, **WIDE), 410)
    assert "its key is destroyed" in said
    assert not (keys_of(first).directory / "subjects" / ada).exists()
    problem(await ask(first, token, f"/api/v1/subjects/{ada}/export"), 404)
    events = await ask(first, token, "/api/v1/events", channel=CHANNEL)
    assert events.json()["items"] == []
    problem(await ask(second, token, SERIES, **WIDE), 410)


@pytest.mark.parametrize("path", ["/api/v1/events", "/api/v1/export", "/api/v1/subjects"])
async def test_each_question_looks_by_itself(
    first: Stand, second: Stand, site: Site, path: str
) -> None:
    token, ada = physician(first), site.ada.pseudonym
    await wear(first, site)
    await first.ingest(site.batch(declared(), pulse(1), beat(2)))
    await notice(second, [], [ada])
    if path == "/api/v1/events":
        answer = await ask(first, token, path, channel=CHANNEL)
        assert answer.json()["items"] == []
    elif path == "/api/v1/export":
        problem(await ask(first, token, path, channel=f"{NODE}/{CHANNEL}"), 410)
    else:
        problem(await ask(first, token, f"{path}/{ada}/export"), 404)


async def test_late_key_is_kept_by_no_cloud(first: Stand, second: Stand, site: Site) -> None:
    await notice(second, [], [site.ada.pseudonym])
    assert await wear(first, site) == ["erased"]
    with pytest.raises(NoKeyError, match="destroyed"):
        keys_of(first).find(site.ada.pseudonym)


async def test_cloud_without_queries_destroys_its_copy_too_also_after_a_fault(
    first: Stand, second: Stand, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    await wear(first, site)
    await notice(second, [], [site.ada.pseudonym])
    faults = iter([StoreError("away"), PrivacyError("locked")])
    apply, stopping = first.cloud.key_access.apply_erasures, asyncio.Event()

    def faulty(connection: Any) -> None:
        fault = next(faults, None)
        if fault is not None:
            raise fault
        apply(connection)
        stopping.set()

    monkeypatch.setattr(erasure, "_INTERVAL_S", 0.01)
    monkeypatch.setattr(first.cloud.key_access, "apply_erasures", faulty)
    async with asyncio.timeout(20):
        await erasure.apply_erasures(first.cloud, stopping)
    assert not (keys_of(first).directory / "subjects" / site.ada.pseudonym).exists()


async def test_live_stream_sends_nothing_sealed_while_erasures_are_unknown(
    first: Stand, second: Stand, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    await wear(first, site)
    await first.ingest(site.batch(declared(), pulse(1)))
    (entry,) = entries(first)
    reader = entry_reader(first, *ALLOWED)
    assert reader.read(entry)
    await notice(second, [], [site.ada.pseudonym])
    with first.cloud.store.read() as connection:
        first.cloud.key_access.apply_erasures(connection)
    assert reader.read(entry) == []
    monkeypatch.setattr(key_access, "_ERASURES_AGE_S", -1.0)
    with pytest.raises(StoreError):
        reader.read(entry)


async def test_key_store_from_before_an_erasure_brings_nothing_back(
    first: Stand, site: Site, tmp_path: Path
) -> None:
    await wear(first, site)
    await first.ingest(site.batch(declared(), pulse(1)))
    ada, keys = site.ada.pseudonym, keys_of(first).directory
    backup = (keys / "subjects" / ada).read_bytes()
    await notice(first, [], [ada])
    (keys / "erased" / ada).unlink()
    (keys / "subjects" / ada).write_bytes(backup)
    (keys / "subjects" / ada).chmod(0o600)
    again = make_cloud(
        first.cloud.settings, first.cloud.store, clock=first.clock, dashboard=tmp_path
    )
    restored = Stand(again, first.clock, first.gateway, first.token)
    problem(await ask(restored, physician(first), SERIES, **WIDE), 410)
    assert not (keys / "subjects" / ada).exists()
