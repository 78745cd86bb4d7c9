"""An older copy of a spool is put in its place while the node runs: what is lost is named."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from tests.support.files import ask
from tests.support.processes import wait_until
from tests.support.stacks import RealStack

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.nightly


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[RealStack]:
    with RealStack(tmp_path, missing_s=3.0) as running:
        yield running


def copy(source: Path, target: Path) -> None:
    """Copy a database while it is written."""
    with closing(sqlite3.connect(source)) as old, closing(sqlite3.connect(target)) as new:
        old.backup(new)


def holes(stack: RealStack) -> list[tuple[int, int]]:
    """Ranges between those that are stored."""
    rows = sorted(ask(stack.store, "SELECT first, last FROM sequences"))
    pairs = pairwise([(0, -1), *rows])
    return [(last + 1, first - 1) for (_, last), (first, _) in pairs if first > last + 1]


def waiting(spool: Path) -> int:
    return int(ask(spool, "SELECT count(*) FROM messages")[0][0])


def test_rolled_back_spool_is_named_by_node_event_and_metric(stack: RealStack) -> None:
    older = stack.folder / "older.sqlite"
    with stack.sensor_node(), stack.operator() as person:
        wait_until(lambda: stack.stored_frames() > 20, "frames are stored")
        stack.cloud.stop()
        copy(stack.spool, older)
        before = waiting(older)
        wait_until(
            lambda: waiting(stack.spool) > before + 200, "the spool holds what it acknowledged"
        )
        stack.gateway.kill()
        for left in stack.folder.glob("spool.sqlite*"):
            left.unlink()
        copy(older, stack.spool)
        stack.start_cloud()
        stack.start_gateway()

        def stated() -> dict[str, object] | None:
            missing: dict[str, object] | None = person.get("nodes/fingertip").json()["missing"]
            return missing

        wait_until(lambda: stated() is not None, "the node's document names what is missing")
        wait_until(lambda: _spans(stated()) == holes(stack), "it names exactly the holes")
        count = sum(last - first + 1 for first, last in holes(stack))
        assert count >= 100
        events = person.get("events", params={"node": "fingertip", "kind": "status"}).json()
        assert any("missing" in event["detail"] for event in events["items"])
        metrics = person.get(str(person.base_url.copy_with(path="/metrics"))).text
        assert f"eskin_cloud_messages_missing {float(count)}" in metrics


def _spans(stated: dict[str, object] | None) -> list[tuple[int, int]]:
    ranges = stated["ranges"] if stated else []
    assert isinstance(ranges, list)
    return [(each["first"], each["last"]) for each in ranges]
