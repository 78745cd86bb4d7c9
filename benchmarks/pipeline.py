"""Frames per second through Mosquitto, gateway and cloud, every commit synced; CPU per frame."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import psutil

from benchmarks.report import Row
from tests.support.files import ask
from tests.support.processes import wait_until
from tests.support.stacks import RealStack

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.processes import Running


def measure_pipeline(folder: Path, *, frames: int) -> list[Row]:
    """A flood of frames of 500 samples from one node, until all are stored.

    CPU is the processes' own, user and system, over the flood. Three processes and the loader
    share the machine's cores, so the rate is one of the whole stack, not of the gateway alone.
    """
    with RealStack(folder) as stack:
        return _flood(stack, frames)


def _flood(stack: RealStack, frames: int) -> list[Row]:
    port = str(stack.broker.node_port)
    loader = [sys.executable, "-m", "benchmarks.loader", str(stack.pki), port, str(frames)]
    processes: tuple[Running, ...] = (stack.broker, stack.gateway, stack.cloud)
    before = {running: cpu_seconds(running) for running in processes}
    with subprocess.Popen(loader, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        started = json.loads(process.stdout.readline())["started"]
        wait_until(lambda: stored_messages(stack) > frames, f"{frames} frames stored", seconds=600)
        finished = time.time()
        process.wait(60)
    spent = {running: cpu_seconds(running) - before[running] for running in before}
    return [
        Row("frames stored end to end", frames / (finished - started), "frames/s"),
        Row("CPU of the gateway a frame", spent[stack.gateway] / frames * 1e6, "us"),
        Row("CPU of the cloud a frame", spent[stack.cloud] / frames * 1e6, "us"),
        Row("CPU of Mosquitto a frame", spent[stack.broker] / frames * 1e6, "us"),
    ]


def stored_messages(stack: RealStack) -> int:
    """How many messages the cloud has stored, compacted or not."""
    query = "SELECT coalesce(sum(last - first + 1), 0) FROM sequences"
    return int(ask(stack.store, query)[0][0])


def cpu_seconds(running: Running) -> float:
    """What a process has used of the processors, user and system."""
    assert running.process is not None
    times = psutil.Process(running.process.pid).cpu_times()
    return float(times.user + times.system)


def resident_bytes(running: Running) -> int:
    """What a process has of the memory."""
    assert running.process is not None
    return int(psutil.Process(running.process.pid).memory_info().rss)
