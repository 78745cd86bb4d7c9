"""Blocks per second through Mosquitto, gateway and cloud, every commit synced; CPU per block."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import psutil

from benchmarks.report import Row
from tests.support.processes import wait_until
from tests.support.stacks import RealStack

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.processes import Running


def measure_pipeline(folder: Path, *, blocks: int) -> list[Row]:
    """A flood of blocks of 250 samples from one node, until all are stored.

    CPU is the processes' own, user and system, over the flood. Three processes and the loader
    share the machine's cores, so the rate is one of the whole stack, not of the gateway alone.
    """
    with RealStack(folder) as stack:
        return _flood(stack, blocks)


def _flood(stack: RealStack, blocks: int) -> list[Row]:
    port = str(stack.broker.node_port)
    loader = [sys.executable, "-m", "benchmarks.loader", str(stack.pki), port, str(blocks)]
    processes: tuple[Running, ...] = (stack.broker, stack.gateway, stack.cloud)
    before = {running: cpu_seconds(running) for running in processes}
    with subprocess.Popen(loader, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        started = json.loads(process.stdout.readline())["started"]
        wait_until(lambda: stack.stored_blocks() >= blocks, f"{blocks} blocks stored", seconds=600)
        finished = time.time()
        process.wait(60)
    spent = {running: cpu_seconds(running) - before[running] for running in before}
    return [
        Row("blocks stored end to end", blocks / (finished - started), "blocks/s"),
        Row("CPU of the gateway a block", spent[stack.gateway] / blocks * 1e6, "us"),
        Row("CPU of the cloud a block", spent[stack.cloud] / blocks * 1e6, "us"),
        Row("CPU of Mosquitto a block", spent[stack.broker] / blocks * 1e6, "us"),
    ]


def cpu_seconds(running: Running) -> float:
    """What a process has used of the processors, user and system."""
    assert running.process is not None
    times = psutil.Process(running.process.pid).cpu_times()
    return float(times.user + times.system)


def resident_bytes(running: Running) -> int:
    """What a process has of the memory."""
    assert running.process is not None
    return int(psutil.Process(running.process.pid).memory_info().rss)
