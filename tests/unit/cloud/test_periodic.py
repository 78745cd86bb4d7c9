"""Background jobs go on after errors."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any
from unittest.mock import Mock

import pytest
from eskin_cloud.jobs import erasure, pg_listener
from eskin_cloud.jobs.heap_trim import trim_heap
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.jobs.silence import watch_silence

from eskin.errors import PrivacyError, StoreError
from eskin.runtime.memory import MUCH

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand


@pytest.mark.anyio
async def test_unexpected_error_is_counted_and_the_job_retried(stand: Stand) -> None:
    stopping = asyncio.Event()
    done = 0

    async def work() -> None:
        nonlocal done
        done += 1
        if done < 3:
            raise OverflowError("unexpected")
        stopping.set()

    await run_periodically("work", work, cloud=stand.cloud, stopping=stopping, every_s=0.001)
    assert done == 3
    assert b'eskin_cloud_faults_total{work="work"} 2.0' in stand.cloud.metrics.write()


@pytest.mark.anyio
async def test_lasting_error_is_logged_once_until_it_is_over(
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
    logged = [record.levelname for record in caplog.records]
    assert logged == ["WARNING"] * 4 + ["ERROR"]
    reasons = [record.args[1] for record in caplog.records[:4] if isinstance(record.args, tuple)]
    assert reasons == [str(each) for each in (away, locked, locked, disk)]
    assert b'eskin_cloud_faults_total{work="work"} 2.0' in stand.cloud.metrics.write()


@pytest.mark.anyio
@pytest.mark.parametrize("name", ["erasures", "memory", "PostgreSQL listener"])
async def test_unexpected_error_does_not_stop_a_job(
    stand: Stand, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """The job runs again after the error: neither its task nor the cloud ended."""
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
    elif name == "memory":
        monkeypatch.setattr(cloud.store, "shrink", breaks)
        monkeypatch.setattr("eskin_cloud.jobs.heap_trim._LITTLE", 2 * MUCH)
        task = trim_heap(cloud, stopping, interval=0.001)
    else:
        monkeypatch.setattr(pg_listener, "_PAUSE_S", 0.001)
        monkeypatch.setattr(pg_listener, "_listen", breaks)
        task = pg_listener.listen(cloud, Mock(), stopping)
    running = asyncio.create_task(task)
    await asyncio.sleep(0)
    cloud.uploads.taken += MUCH
    async with asyncio.timeout(20):
        await stopping.wait()
    running.cancel()
    await asyncio.wait([running])
    assert f'work="{name}"'.encode() in cloud.metrics.write()


@pytest.mark.anyio
async def test_lasting_store_error_is_logged_once_by_the_silence_job(
    stand: Stand, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    times, stopping = 0, asyncio.Event()

    def away(*_: object, **__: object) -> None:
        nonlocal times
        times += 1
        if times == 5:
            stopping.set()
        raise StoreError("away")

    monkeypatch.setattr("eskin_cloud.jobs.silence._INTERVAL_S", 0.001)
    monkeypatch.setattr("eskin_cloud.jobs.silence.SECOND", 0)  # so that every silence is too long
    monkeypatch.setattr("eskin_cloud.jobs.silence.find_silent", away)
    async with asyncio.timeout(60):
        await watch_silence(stand.cloud, stopping)
    assert times >= 5
    assert caplog.text.count("away") == 1
