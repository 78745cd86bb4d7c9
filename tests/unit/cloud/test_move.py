"""Move a store from SQLite to PostgreSQL, also after a power cut."""

from __future__ import annotations

import asyncio
import os
import re
import signal
from contextlib import nullcontext
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.service import only_one
from eskin_cloud.store import Store
from eskin_cloud.store.feed_entry import last_position
from eskin_cloud.store.move import TABLES, move
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.write.clock_state import ClockReading, save_clock
from sqlalchemy import func, select, text

from eskin.errors import StoreError
from eskin.wire.slot import SLOTS, slot_of
from tests.support.commands import run, run_before_people
from tests.support.files import write_settings
from tests.support.stores import write_place
from tests.unit.cloud.clouds import put
from tests.unit.cloud.everything import fill
from tests.unit.cloud.messages import START, stretch
from tests.unit.cloud.sealing import Site, sealing

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sqlalchemy import URL, Row

    from tests.support.identities import Identities
    from tests.support.postgresql import Cluster

_MANY = 1203
"""Frames beside all else: some pages of them."""


@pytest.fixture
def source(tmp_path: Path, identities: Identities) -> Path:
    """A store with something in every table."""
    with sealing(tmp_path, identities) as stand:
        asyncio.run(fill(stand, Site(tmp_path)))
        many = (stretch(1000 + number, [-float("inf")], [0.1]) for number in range(_MANY))
        put(stand.cloud.store, *many)
        reading = ClockReading(stand.clock(), 2, 3)
        stand.cloud.store.write_and_wait(lambda connection: save_clock(connection, reading))
        return tmp_path / "store.sqlite"


def count(place: Path | URL) -> int:
    with Store(place) as store, store.read() as connection:
        return connection.execute(select(func.count()).select_from(frames)).scalar_one()


def rows(place: Path | URL) -> dict[str, Sequence[Row[tuple[object, ...]]]]:
    """All rows of all tables that are moved."""
    with Store(place) as store, store.read() as connection:
        return {
            table.name: connection.execute(select(table).order_by(*table.primary_key.columns)).all()
            for table in TABLES
        }


def check(target: URL, source: Path) -> None:
    """Table by table, whether all is there."""
    arrived, left = rows(target), rows(source)
    assert [name for name, found in left.items() if not found] == []
    for name, expected in left.items():
        assert arrived[name] == expected, name


def killed_at_step(source: Path, target: URL, step: int) -> None:
    """Move in a process that a power cut ends."""

    def die(done: int, _: int) -> None:
        if done >= step:
            os.kill(os.getpid(), signal.SIGKILL)

    child = os.fork()
    if child == 0:
        try:
            move(source, target, now=START, progress=die)
        finally:
            os._exit(1)
    _, ended = os.waitpid(child, 0)
    assert os.WTERMSIG(ended) == signal.SIGKILL


def settings_for(folder: Path, target: Path | URL) -> str:
    """A cloud's settings that name where its store is to be."""
    gateways: dict[str, object] = {"identity": folder}
    sections = {"store": write_place(target), "gateways": gateways}
    return str(write_settings(folder / "cloud.toml", sections))


@pytest.mark.nightly
def test_killed_move_resumes_and_copies_everything(source: Path, cluster: Cluster) -> None:
    target = cluster.fresh(empty=True)
    total = sum(map(len, rows(source).values()))
    killed_at_step(source, target, total // 2)
    assert 0 < count(target) < count(source)
    with Store(target) as store, pytest.raises(StoreError, match="is being moved here"):
        put(store, stretch(0))
    killed_at_step(source, target, total + total // 2)  # while it compares
    assert count(target) == count(source)
    stated: list[tuple[int, int]] = []
    counts = move(source, target, now=START, progress=lambda *step: stated.append(step))
    assert counts == {name: len(found) for name, found in rows(source).items()}
    assert stated[-1] == (2 * total, 2 * total)
    check(target, source)
    with Store(source) as store, store.read() as connection:
        last = last_position(connection)
    with Store(target) as store:
        outcome = put(store, stretch(1000, [-float("inf")], [0.1]), stretch(5000))
        assert [receipt.result for receipt in outcome.results] == ["duplicate", "stored"]
        assert outcome.entries[0].cursor == last.cursors[slot_of("fingertip")] + SLOTS


def test_command_moves_everything_and_draws_a_progress_bar(
    source: Path, cluster: Cluster, tmp_path: Path
) -> None:
    target = cluster.fresh(empty=True)
    words = ("cloud", "move", "--config", settings_for(tmp_path, target), "--from", str(source))
    done = run_before_people(*words)
    assert done.returncode == 0, done.stderr
    assert re.search("moving.*━.*100%", done.stderr), done.stderr
    *lines, last = done.stdout.splitlines()
    assert last == "moved, and compared page by page"
    counts = {name: int(number) for number, name in map(str.split, lines)}
    assert counts == {name: len(found) for name, found in rows(source).items()}
    check(target, source)


@pytest.mark.nightly
def test_command_draws_nothing_into_a_file(source: Path, cluster: Cluster, tmp_path: Path) -> None:
    target = cluster.fresh(empty=True)
    words = ("cloud", "move", "--config", settings_for(tmp_path, target), "--from", str(source))
    done = run(*words)
    assert (done.returncode, done.stderr) == (0, "")
    assert "\x1b" not in done.stdout
    again = run(*words)
    assert again.returncode != 0
    assert "not empty" in again.stderr
    check(target, source)


def test_command_moves_no_store_in_use_and_none_onto_itself(
    source: Path, cluster: Cluster, tmp_path: Path
) -> None:
    target, before = cluster.fresh(empty=True), rows(source)
    for place, held, said in (
        (target, only_one(source), "stop it first"),
        (source, nullcontext(), "not empty"),
    ):
        words = ("cloud", "move", "--config", settings_for(tmp_path, place), "--from", str(source))
        with held:
            refused = run(*words)
        assert refused.returncode != 0
        assert said in refused.stderr
    assert count(target) == 0
    assert rows(source) == before


def test_difference_is_detected(source: Path, cluster: Cluster) -> None:
    target = cluster.fresh(empty=True)
    total = sum(map(len, rows(source).values()))
    killed_at_step(source, target, total + total // 2)
    change = text("UPDATE frames SET samples = 9 WHERE sequence = 1700")
    cluster.execute(str(change), database=str(target.database))
    with pytest.raises(StoreError, match="copy differs"):
        move(source, target, now=START)
    with Store(target) as store, pytest.raises(StoreError, match="is being moved here"):
        put(store, stretch(0))


def test_store_in_use_is_rejected_as_target(source: Path, cluster: Cluster) -> None:
    target = cluster.fresh()
    with Store(target) as store:
        put(store, stretch(0))
    with pytest.raises(StoreError, match="not empty"):
        move(source, target, now=START)
