"""Fixtures of the cloud's tests."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, Final

import pytest
from eskin_cloud.store import Store
from sqlalchemy import URL

from tests.unit.cloud.clouds import Clock, Stand, standing
from tests.unit.cloud.messages import START
from tests.unit.cloud.sealing import Site

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from tests.support.identities import Identities
    from tests.support.postgresql import Cluster


@pytest.fixture
def clock() -> Clock:
    """A clock at the time of the test messages."""
    return Clock(START)


ALONE: Final = {f"tests.unit.cloud.test_{room}" for room in (
    "access", "chore", "client", "compared", "damaged_rows", "description",
    "gatekeeper", "http", "limits", "odd_requests", "rollup_rates", "subject_export",
    "withheld",
)}  # fmt: skip
"""Tests that run on SQLite alone, because they do not depend on the kind of store."""
BOTH: Final = {f"tests.unit.cloud.test_{room}" for room in (
    "faults", "frames_once", "live", "missing_messages", "patch_compaction", "patch_retention",
    "pg_copy", "queries", "several_clouds", "shared_commits", "slots", "store",
    "store_settings", "stored_sequences", "writer",
)}  # fmt: skip
"""Tests of what depends on the kind of store: writer, locks, SQL. Others run on PostgreSQL
at night."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run tests with a ``place`` on each kind of store."""
    chosen = [mark.args[0] for mark in metafunc.definition.iter_markers("parametrize")]
    if "place" in metafunc.fixturenames and "place" not in chosen:
        room = metafunc.module.__name__
        marks = () if room in BOTH else pytest.mark.nightly
        kinds = ["sqlite", pytest.param("postgresql", marks=marks)]
        metafunc.parametrize("place", kinds[:1] if room in ALONE else kinds, indirect=True)


@pytest.fixture(scope="session")
def empty_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with all tables and no rows: a copy is there twice as fast as a new one."""
    path = tmp_path_factory.mktemp("empty") / "store.sqlite"
    Store(path).close()
    return path


@pytest.fixture
def place(request: pytest.FixtureRequest, tmp_path: Path) -> StoreLocation:
    """Where an empty store is, for each kind of store."""
    if request.param == "sqlite":
        empty: Path = request.getfixturevalue("empty_store")
        return shutil.copyfile(empty, tmp_path / "store.sqlite")
    cluster: Cluster = request.getfixturevalue("cluster")
    place: StoreLocation = request.getfixturevalue("shared_database")
    assert isinstance(place, URL)
    cluster.clear(place)
    return place


@pytest.fixture(scope="session")
def shared_database(cluster: Cluster) -> URL:
    """A database that is emptied for each test."""
    return cluster.fresh()


@pytest.fixture
def store(place: StoreLocation, clock: Clock) -> Iterator[Store]:
    """An empty store."""
    with Store(place, clock=clock) as opened:
        yield opened


@pytest.fixture
def site(tmp_path: Path) -> Site:
    """A gateway's key store, and what it brings."""
    return Site(tmp_path)


@pytest.fixture
def stand(tmp_path: Path, identities: Identities, place: StoreLocation) -> Iterator[Stand]:
    """A cloud with clients."""
    with standing(tmp_path, identities, place=place) as made:
        yield made


@pytest.fixture
def anyio_backend() -> str:
    """Asynchronous tests run on asyncio, as the cloud does."""
    return "asyncio"
