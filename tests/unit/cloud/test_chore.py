"""Work in the background goes on whatever becomes of it."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any
from unittest.mock import Mock

import pytest
from eskin_cloud.jobs import erasure, pg_listener
from eskin_cloud.jobs.heap_trim import trim_heap
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.jobs.silence import watch

from eskin.errors import PrivacyError, StoreError
from eskin.runtime.memory import MUCH

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.unit.cloud.clouds import Stand


@pytest.mark.anyio
async def test_work_that_broke_is_counted_and_tried_again(stand: Stand) -> None:
    stopping = asyncio.Event()
    done = 0

    async def work() -> None:
        nonlocal done
        done += 1
        if done < 3:
            raise OverflowError("nobody foresaw it")
        stopping.set()

    await run_periodically("work", work, cloud=stand.cloud, stopping=stopping, every_s=0.001)
    assert done == 3
    assert b'eskin_cloud_faults_total{work="work"} 2.0' in stand.cloud.metrics.write()


@pytest.mark.anyio
async def test_what_lasts_is_told_once_until_it_is_well_again(
    stand: Stand, caplog: pytest.LogCaptureFixture
) -> None:
    stopping = asyncio.Event()
    away, locked, disk = StoreError("away"), PrivacyError("locked"), OSError("worn disk")
    unforeseen = RuntimeError("no thread")
    faults = iter([away, away, locked, locked, None, locked, disk, disk, unforeseen, unforeseen])

    async def work() -> None:
        fault = next(faults, stopping)
        if isinstance(fault, Exception):
            raise fault
        if fault is stopping:
            stopping.set()

    await run_periodically("work", work, cloud=stand.cloud, stopping=stopping, every_s=0.001)
    told = [(record.levelname, record.getMessage()) for record in caplog.records]
    reasons = ["away", "locked", "locked", "worn disk"]
    warnings = [("WARNING", f"work: trying again: reason={reason}") for reason in reasons]
    assert told == [*warnings, ("ERROR", "work: broke, trying again")]
    assert b'eskin_cloud_faults_total{work="work"} 2.0' in stand.cloud.metrics.write()


@pytest.mark.anyio
@pytest.mark.parametrize("name", ["erasures", "watch", "memory", "relay"])
async def test_what_nobody_foresaw_ends_no_work_in_the_background(
    stand: Stand, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """The work is done again after it broke, so its task did not end, and the cloud neither."""
    cloud, stopping, times = stand.cloud, asyncio.Event(), 0

    def breaks(*_: Any) -> None:
        nonlocal times
        times += 1
        if times > 2:
            stopping.set()
        cloud.uploads.taken += MUCH  # a load, for those who rest after one
        raise RuntimeError("can't start new thread")

    if name == "erasures":
        monkeypatch.setattr(erasure, "_INTERVAL_S", 0.001)
        monkeypatch.setattr(erasure, "_apply", breaks)
        monkeypatch.setattr(cloud.key_access, "keystore", Mock())
        task = erasure.apply_erasures(cloud, stopping)
    elif name == "watch":
        monkeypatch.setattr("eskin_cloud.jobs.silence._INTERVAL", 0.001)
        task = watch(cloud, [Mock(refresh=breaks)], stopping)
    elif name == "memory":
        monkeypatch.setattr(cloud.store, "shrink", breaks)
        monkeypatch.setattr("eskin_cloud.jobs.heap_trim._LITTLE", 2 * MUCH)
        task = trim_heap(cloud, stopping, interval=0.001)
    else:
        monkeypatch.setattr(pg_listener, "_PAUSE_S", 0.001)
        monkeypatch.setattr(pg_listener, "_listen", breaks)
        task = pg_listener.relay(cloud, Mock())
    running = asyncio.create_task(task)
    await asyncio.sleep(0)
    cloud.uploads.taken += MUCH
    async with asyncio.timeout(20):
        await stopping.wait()
    running.cancel()
    await asyncio.wait([running])
    assert f'work="{name}"'.encode() in cloud.metrics.write()


@pytest.mark.anyio
async def test_server_that_is_not_heard_is_told_once_until_it_was_heard(
    stand: Stand, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A night without a database shall not fill a log."""
    faults = iter([OSError("away"), OSError("away"), None, OSError("away"), OSError("away")])
    ended = asyncio.Event()

    async def listen(_: object, __: object, listening: Callable[[], None]) -> None:
        fault = next(faults, ended)
        if isinstance(fault, OSError):
            raise fault
        listening()
        if fault is ended:
            ended.set()

    monkeypatch.setattr(pg_listener, "_PAUSE_S", 0.001)
    monkeypatch.setattr(pg_listener, "_listen", listen)
    running = asyncio.create_task(pg_listener.relay(stand.cloud, Mock()))
    async with asyncio.timeout(60):
        await ended.wait()
    running.cancel()
    await asyncio.wait([running])
    assert caplog.text.count("other processes are not heard: reason=away") == 2


@pytest.mark.anyio
async def test_store_that_is_away_for_long_is_told_once_by_who_looks_after_nodes(
    stand: Stand, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    times, stopping = 0, asyncio.Event()

    def away(*_: object, **__: object) -> None:
        nonlocal times
        times += 1
        if times == 5:
            stopping.set()
        raise StoreError("away")

    monkeypatch.setattr("eskin_cloud.jobs.silence._INTERVAL", 0.001)
    monkeypatch.setattr("eskin_cloud.jobs.silence.SECOND", 0)  # so that every silence is too long
    monkeypatch.setattr(stand.cloud.store, "write", away)
    async with asyncio.timeout(60):
        await watch(stand.cloud, [], stopping)
    assert times >= 5
    assert caplog.text.count("away") == 1
