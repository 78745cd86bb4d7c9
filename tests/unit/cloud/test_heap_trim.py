"""A load that is gone leaves no memory taken, and a steady one is not disturbed."""

from __future__ import annotations

import asyncio
from contextlib import ExitStack
from typing import TYPE_CHECKING
from unittest.mock import Mock, patch

from eskin_cloud.ingest.upload_budget import UploadBudget
from eskin_cloud.jobs.heap_trim import trim_heap
from eskin_cloud.store import Store
from sqlalchemy import Engine, event

from eskin.errors import StoreError
from eskin.runtime.memory import MUCH, give_back

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import pytest
    from sqlalchemy import Connection


def shrunk(
    loads: Sequence[int],
    *,
    packed: Sequence[int] = (),
    seconds: float = 5.0,
    fault: Exception | None = None,
) -> list[int]:
    """Which interval began with a shrinking, where so many bytes came, or were packed, before.

    What the allocator keeps is given back right after each, also after one that failed.
    """
    uploads, stopping, found = UploadBudget(1 << 40), asyncio.Event(), []
    given: list[int] = []
    waiting, packing = iter(loads), iter(packed)
    turn = 0

    def shrink() -> None:
        found.append(turn)
        if fault is not None:
            raise fault

    class Steps(asyncio.Event):
        """Ends each interval at once, and with the last one the task."""

        async def wait(self) -> bool:  # type: ignore[override]
            nonlocal turn
            turn += 1
            load = next(waiting, None)
            if load is None:
                stopping.set()
                self.set()
                return True
            with uploads.hold(load):
                pass
            cloud.store.compacted += next(packing, 0)
            raise TimeoutError

    cloud = Mock(uploads=uploads)
    cloud.store.shrink, cloud.store.compacted = shrink, 0
    with patch("eskin_cloud.jobs.heap_trim.give_back", lambda: given.append(turn)):
        asyncio.run(trim_heap(cloud, Steps(), interval=60.0, clock=lambda: turn * seconds))
    assert given == found
    return found


def test_memory_is_given_back_once_after_a_load_is_gone() -> None:
    assert shrunk([MUCH, MUCH, 0, 0, 0]) == [3]


def test_packing_that_goes_on_after_a_load_is_followed_by_a_rest_of_its_own() -> None:
    assert shrunk([MUCH] + [0] * 5, packed=[0, MUCH, MUCH, 100, 0, 0]) == [2, 5]


def test_packing_in_small_steps_is_followed_by_one_rest() -> None:
    assert shrunk([0] * 40, packed=[MUCH // 32] * 34) == [35]


def test_packing_behind_a_load_that_goes_on_is_left_alone() -> None:
    assert shrunk([MUCH // 2] * 5, packed=[MUCH] * 5) == []


def test_steady_load_and_a_trickle_are_left_alone() -> None:
    assert shrunk([MUCH // 2] * 6) == []
    assert shrunk([10] * 6) == []


def test_trickle_after_a_load_hinders_nothing() -> None:
    assert shrunk([MUCH, 10, 10, 10]) == [2]


def test_memory_is_given_back_now_and_then_under_a_load_that_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = []
    monkeypatch.setattr("eskin.runtime.memory.give_back", lambda: given.append(True))
    assert shrunk([MUCH] * 6, seconds=20.0) == []
    assert len(given) == 2
    assert shrunk([0] * 6, packed=[MUCH] * 6, seconds=20.0) == []
    assert len(given) == 4
    assert shrunk([10] * 6, seconds=20.0) == []
    assert len(given) == 4


def test_store_that_cannot_shrink_ends_nothing() -> None:
    assert shrunk([MUCH, 0, MUCH, 0, 0], fault=StoreError("full")) == [2, 4]


def test_store_has_each_of_its_connections_give_memory_back_and_goes_on(tmp_path: Path) -> None:
    asked: list[object] = []

    def look(connection: Connection, _: object, words: str, *__: object) -> None:
        if words == "PRAGMA shrink_memory":
            asked.append(connection.connection.driver_connection)

    with Store(tmp_path / "store.sqlite", readers=3) as store:
        with ExitStack() as reading:
            for _ in range(3):
                reading.enter_context(store.read())
        event.listen(Engine, "before_cursor_execute", look)
        try:
            store.shrink()
        finally:
            event.remove(Engine, "before_cursor_execute", look)
        assert len(set(asked)) == 1 + 3
        give_back()
        store.check()
        assert store.write(lambda _: 7).result(timeout=30) == 7
