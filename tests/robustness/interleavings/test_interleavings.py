"""Clouds on one store keep the laws, in whichever order the server runs their statements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import pytest
from eskin_cloud.store.schema.tables import feed
from sqlalchemy import select

from tests.robustness.interleavings.explorer import Replay, Sample, Search
from tests.robustness.interleavings.operations import OPERATIONS
from tests.robustness.interleavings.scenarios import PAIRS, TRIPLES, explore
from tests.robustness.interleavings.scheduler import Scheduler
from tests.robustness.interleavings.world import SLOTS_USED, opened

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin_cloud.store.write.write_cache import WriteCache
    from sqlalchemy import Connection

    from tests.robustness.interleavings.operations import Unit
    from tests.robustness.interleavings.world import World

pytestmark = pytest.mark.schedules

SCHEDULES: Final = {
    "ingest-ingest": 20, "ingest-erase": 24, "ingest-compact": 18, "ingest-build": 14,
    "ingest-read": 18, "ingest-move": 6, "erase-erase": 8, "erase-compact": 8, "erase-build": 6,
    "erase-read": 8, "erase-move": 3, "compact-compact": 8, "compact-build": 10,
    "compact-read": 8, "compact-move": 3, "build-build": 6, "build-read": 6, "build-move": 2,
    "read-read": 1, "read-move": 3, "move-move": 2, "ingest-ingest-erase": 6,
    "ingest-compact-read": 4, "ingest-build-compact": 3, "ingest-erase-compact": 3,
    "ingest-move-read": 2,
}  # fmt: skip
"""How many are run: more where they are short and the laws many."""
assert sum(SCHEDULES.values()) == 200


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with opened(tmp_path_factory.mktemp("interleavings")) as made:
        yield made


@pytest.mark.parametrize("name", SCHEDULES)
def test_laws_hold_in_each_schedule(world: World, name: str) -> None:
    scheduler, most = Scheduler(world, name.split("-")), SCHEDULES[name]
    with scheduler.installed():
        # A builder of tiles has few steps: it is interrupted at each.
        strategy = Search(1) if name == "compact-build" else Sample(1, 2)
        report = explore(world, scheduler, strategy, most=most)
    for execution, laws in report.violations:
        pytest.fail("\n".join([*laws, *execution.lines()]))
    assert report.schedules == most


def test_each_pair_and_triple_is_explored() -> None:
    assert set(SCHEDULES) == {"-".join(each) for each in (*PAIRS, *TRIPLES)}


def test_schedule_runs_again_as_it_was(world: World) -> None:
    """Also where a unit waits for a lock of another one."""
    scheduler = Scheduler(world, ("ingest", "ingest"))
    with scheduler.installed():
        found = [e for e in Search(None).explore(scheduler.run) if e.blocked]
        assert found
        for execution in found:
            again = scheduler.run(Replay(execution.order))
            assert again.lines() == execution.lines()


def locking(first: int, second: int) -> Callable[[Unit], None]:
    """Locks a slot, then another one."""

    def run(unit: Unit) -> None:
        def work(connection: Connection, _: WriteCache) -> None:
            query = select(feed.c.slot).where(feed.c.slot == second)
            connection.execute(query.with_for_update())

        unit.store.write_slots([first], work).result(60)

    return run


def test_units_that_wait_for_each_other_are_found(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    near, far = SLOTS_USED
    monkeypatch.setitem(OPERATIONS, "forth", locking(near, far))
    monkeypatch.setitem(OPERATIONS, "back", locking(far, near))
    scheduler = Scheduler(world, ("forth", "back"))
    with scheduler.installed():
        report = explore(world, scheduler, Search(None), most=99)
    assert report.complete
    assert report.violations
    assert all("deadlock" in "".join(laws) for _, laws in report.violations)
    assert len(report.violations) < report.schedules
