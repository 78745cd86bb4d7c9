"""Blocks per second through Mosquitto, gateway and cloud, every commit synced; CPU per block."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from typing import TYPE_CHECKING

import psutil

from benchmarks.report import Row
from eskin.identity import IdentityKind
from tests.brokers import Mosquitto
from tests.files import write_settings
from tests.identities import Identities
from tests.processes import ESKIN, Running, accepts, free_port, wait_until

if TYPE_CHECKING:
    from pathlib import Path


def measure_pipeline(folder: Path, *, blocks: int) -> list[Row]:
    """A flood of blocks of 250 samples from one node, until all are stored.

    CPU is the processes' own, user and system, over the flood. Three processes and the loader
    share the machine's cores, so the rate is one of the whole stack, not of the gateway alone.
    """
    folder.mkdir(parents=True)
    identities = Identities(folder / "pki")
    identities.make(IdentityKind.SERVER, "server.cloud")
    store = folder / "store.sqlite"
    ingest, people = free_port(), free_port()
    cloud_toml = write_settings(folder / "cloud.toml", {
        "store": {"path": store},
        "people": {"port": people},
        "gateways": {"port": ingest, "identity": folder / "pki" / "server.cloud"},
    })  # fmt: skip
    with (
        Mosquitto(folder / "broker", identities) as broker,
        Running([ESKIN, "cloud", "--config", str(cloud_toml)], log=folder / "cloud.log") as cloud,
    ):
        gateway_toml = write_settings(folder / "gateway.toml", {
            "broker": {"host": "127.0.0.1", "port": broker.gateway_port},
            "identity": {"directory": folder / "pki" / "gateway.g1",
                         "site": folder / "pki" / "site.main"},
            "cloud": {"url": f"https://127.0.0.1:{ingest}/api/v1/ingest"},
            "spool": {"path": folder / "spool.sqlite"},
            "http": {"port": free_port()},
        })  # fmt: skip
        cloud.wait_for(lambda: accepts(ingest), "the cloud listens")
        argv = [ESKIN, "gateway", "--config", str(gateway_toml)]
        with Running(argv, log=folder / "gateway.log") as gateway:
            return _flood(folder, broker, gateway, cloud, store, blocks)


def _flood(
    folder: Path, broker: Mosquitto, gateway: Running, cloud: Running, store: Path, blocks: int
) -> list[Row]:
    port = str(broker.node_port)
    loader = [sys.executable, "-m", "benchmarks.loader", str(folder / "pki"), port, str(blocks)]
    processes: tuple[Running, ...] = (broker, gateway, cloud)
    before = {running: _cpu(running) for running in processes}
    with subprocess.Popen(loader, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        started = json.loads(process.stdout.readline())["started"]
        wait_until(lambda: _count(store) >= blocks, f"{blocks} blocks stored", seconds=600)
        finished = time.time()
        process.wait(60)
    spent = {running: _cpu(running) - before[running] for running in before}
    return [
        Row("blocks stored end to end", blocks / (finished - started), "blocks/s"),
        Row("CPU of the gateway a block", spent[gateway] / blocks * 1e6, "us"),
        Row("CPU of the cloud a block", spent[cloud] / blocks * 1e6, "us"),
        Row("CPU of Mosquitto a block", spent[broker] / blocks * 1e6, "us"),
    ]


def _count(store: Path) -> int:
    with closing(sqlite3.connect(f"file:{store}?mode=ro", uri=True)) as db:
        return int(db.execute("SELECT count(*) FROM blocks").fetchone()[0])


def _cpu(running: Running) -> float:
    assert running.process is not None
    times = psutil.Process(running.process.pid).cpu_times()
    return float(times.user + times.system)
