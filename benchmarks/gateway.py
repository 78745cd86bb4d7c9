"""The gateway beside its peers: CPU of a message, messages a second, latency.

The peers: a plain paho relay and a bare subscriber (`benchmarks.relay`), Mosquitto's bridge and
thingsboard-gateway with either of its storages (`benchmarks.far_peers`).

Every subject is stopped while the broker fills with frames of 500 samples (TLS, QoS 1), and then
let go: what is measured is the subject that takes them as fast as it can, with no sender beside it.
Rounds alternate, so that a noisy machine is noisy for all.
"""

from __future__ import annotations

import signal
import sqlite3
import sys
import time
from contextlib import closing
from statistics import median
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.far_peers import FAR_PEERS, Relayed, Upstream, measure_far
from benchmarks.flood import Flood
from benchmarks.pipeline import cpu_seconds, resident_bytes
from benchmarks.relay import NAME
from benchmarks.report import Row
from eskin.identity import IdentityKind
from tests.support.processes import Running, wait_until
from tests.support.stacks import RealStack

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_ROUNDS: Final = 3
_WARM: Final = 500
"""Frames after which compiled parts are loaded; they are no part of what one costs."""
_STRETCH_US: Final = 60.0
_DURABLE: Final = 10_000.0
_PACE_HZ: Final = 100.0
_LATENCY_MS: Final = 20.0
_REST_S: Final = 12.0
_GROWTH: Final = 1.1
_SAMPLES_RATIO: Final = 30.0


def measure_gateway(folder: Path, *, frames: int) -> list[Row]:
    """CPU a frame, frames made durable a second, and p50 from publish to stored at 100/s.

    The gateway's CPU is all that it does for a frame: open, spool, acknowledge, publish its hull,
    forward it to the cloud and receive its answer.
    """
    with RealStack(folder) as stack, Flood(stack.pki, stack.broker.node_port) as flood:
        stack.identities.make(IdentityKind.GATEWAY, NAME)
        found: dict[str, list[tuple[float, float]]] = {"gateway": [], "relay": [], "subscriber": []}
        far: dict[str, list[Relayed]] = {peer: [] for peer in FAR_PEERS}
        _gateway(stack, flood, _WARM)
        time.sleep(_REST_S)
        idle = resident_bytes(stack.cloud)
        with Upstream(stack) as upstream:
            for _ in range(_ROUNDS):
                _gateway(stack, flood, _WARM)
                found["gateway"].append(_gateway(stack, flood, frames))
                stack.gateway.stop()
                for peer in ("relay", "subscriber"):
                    found[peer].append(_peer(stack, flood, peer, frames))
                for name, rounds in far.items():
                    # A message of values costs as much as many of text.
                    count = frames // 10 if FAR_PEERS[name].rows else frames
                    rounds.append(measure_far(stack, flood, upstream, name, count))
                stack.start_gateway()
        flood.introduce()
        latency = _latency(stack, flood)
        memory = _memory(stack, flood, frames, idle)
    return _rows(found, latency) + memory + _far_rows(found["gateway"], far)


def _gateway(stack: RealStack, flood: Flood, frames: int) -> tuple[float, float]:
    flood.introduce()
    used, begun = _drain(stack.gateway, flood, frames, lambda: flood.wait_for(frames))
    durable = frames / (flood.finished - begun) * 1e9
    wait_until(lambda: flood.stored(stack.store) >= frames, "all stored", seconds=300)
    return (cpu_seconds(stack.gateway) - used) / frames * 1e6, durable


def _peer(stack: RealStack, flood: Flood, peer: str, frames: int) -> tuple[float, float]:
    """One peer alone at the broker: the gateway is ended meanwhile."""
    log = stack.folder / f"{peer}-{time.time_ns()}.log"
    port = str(stack.broker.gateway_port)
    argv = [sys.executable, "-m", "benchmarks.relay", str(stack.pki), port, peer, str(frames)]
    with Running(argv, log=log) as running:
        running.wait_for(lambda: "subscribed" in running.output(), "the peer is subscribed")
        used, begun = _drain(running, flood, frames, lambda: _wait_done(running))
        spent = cpu_seconds(running) - used
        done = int(running.output().split("done ")[1].split()[0])
    return spent / frames * 1e6, frames / (done - begun) * 1e9


def _drain(
    running: Running, flood: Flood, frames: int, wait: Callable[[], None]
) -> tuple[float, int]:
    """Let a subject take what the broker holds; gives its CPU seconds before, and when it began."""
    envelopes = flood.seal(frames)
    used = cpu_seconds(running)
    running.signal(signal.SIGSTOP)
    try:
        flood.fill(envelopes)
        begun = time.time_ns()
    finally:
        running.signal(signal.SIGCONT)
    wait()
    return used, begun


def _wait_done(running: Running) -> None:
    running.wait_for(lambda: "done" in running.output(), "the peer took all", seconds=300)


def _latency(stack: RealStack, flood: Flood) -> float:
    """Median ms from publish to the store's commit, at a hundred frames a second."""
    count = int(_PACE_HZ * 10)
    sent = np.zeros(count + 1, dtype=np.int64)
    started = time.monotonic()
    for number, envelope in enumerate(flood.seal(count), start=1):
        time.sleep(max(0.0, started + number / _PACE_HZ - time.monotonic()))
        sent[number] = time.time_ns()
        flood.send(envelope)
    wait_until(lambda: flood.stored(stack.store) >= count, "all stored", seconds=60)
    with closing(sqlite3.connect(f"file:{stack.store}?mode=ro", uri=True)) as db:
        query = "SELECT sequence, received FROM frames WHERE boot = ? ORDER BY sequence"
        stored = np.array(db.execute(query, (flood.boot,)).fetchall(), dtype=np.int64)
    return float(np.median(stored[:, 1] - sent[stored[:, 0]])) / 1e6


def _memory(stack: RealStack, flood: Flood, frames: int, idle: int) -> list[Row]:
    """Memory some seconds after a flood, beside that before it; of the cloud, before any."""
    tiers = {"gateway": stack.gateway, "cloud": stack.cloud}
    time.sleep(_REST_S)
    before = {"gateway": resident_bytes(stack.gateway), "cloud": idle}
    _gateway(stack, flood, frames * 2)
    time.sleep(_REST_S)
    return [
        Row(f"memory of the {name} after a flood", resident_bytes(tier) / 1e6, "MB", "before it",
            before[name] / 1e6, before[name] / resident_bytes(tier), 1 / _GROWTH,
            resident_bytes(tier) <= _GROWTH * before[name])
        for name, tier in tiers.items()
    ]  # fmt: skip


def _rows(found: dict[str, list[tuple[float, float]]], latency: float) -> list[Row]:
    cpu = {who: median(used for used, _ in rounds) for who, rounds in found.items()}
    rate = {who: median(rates for _, rates in rounds) for who, rounds in found.items()}
    own, relay = cpu["gateway"], cpu["relay"]
    return [
        Row(
            "CPU of the gateway a frame (flood)", own, "us", "paho relay", relay, relay / own, 1.0,
            own <= relay,
        ),
        Row("the same, at most 60 us", own, "us", "stretch", _STRETCH_US, _STRETCH_US / own, 1.0,
            own <= _STRETCH_US),
        Row("CPU of a bare paho subscriber a frame", cpu["subscriber"], "us"),
        Row(
            "frames a gateway makes durable", rate["gateway"], "frames/s", "paho relay (volatile)",
            rate["relay"], rate["gateway"] / rate["relay"], None, None,
        ),
        Row("the same, at least 10 k/s", rate["gateway"], "frames/s", target=_DURABLE,
            met=rate["gateway"] >= _DURABLE),
        Row("publish to stored at 100 frames/s, p50", latency, "ms", "at most", _LATENCY_MS,
            _LATENCY_MS / latency, 1.0, latency <= _LATENCY_MS),
    ]  # fmt: skip


def _far_rows(own: list[tuple[float, float]], far: dict[str, list[Relayed]]) -> list[Row]:
    """The same beside those that bring messages to a second broker."""
    cpu, rate = (median(figures) for figures in zip(*own, strict=True))
    rows: list[Row] = []
    for name, (storage, stated) in FAR_PEERS.items():
        their_cpu, their_rate, lost = (median(figures) for figures in zip(*far[name], strict=True))
        # A bridge in C neither opens, checks, stores nor answers: no target, but the distance.
        least = _SAMPLES_RATIO if stated else 1.0
        target, met = (None, None) if storage is None else (least, cpu * least <= their_cpu)
        faster = None if storage is None else rate >= their_rate
        known = None if storage is None else 1.0
        rows += [
            Row("CPU of the gateway a frame (flood)", cpu, "us", name, their_cpu,
                their_cpu / cpu, target, met),
            Row("frames a gateway makes durable", rate, "frames/s", f"{name} (not durable)",
                their_rate, rate / their_rate, known, faster),
            Row(f"messages that {name} lost without a fault", lost, "messages"),
        ]  # fmt: skip
    return rows
