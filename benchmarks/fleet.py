"""Thousands of nodes in one process: over the network, and in physics and firmware alone."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Final

import psutil
from eskin_sensor_node.fleet.cohort import Cohort
from eskin_sensor_node.fleet.roster import Roster, RosterEntry
from eskin_sensor_node.profile import Profile
from eskin_sensor_node.settings import NodeSettings

from benchmarks.pipeline import cpu_seconds, stored_messages
from benchmarks.report import Row
from tests.support.fleets import RunningFleet, enrol
from tests.support.stacks import RealStack

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tests.support.processes import Running

_SAMPLING_HZ: Final = 128.0
_STRETCH_MS: Final = 1000.0
"""A frame of 128 samples each second, and the peaks: a little more than a message a second."""
_IDLE_HZ: Final = 0.01
_STATUS_S: Final = 30.0
_SETTLE_S: Final = 6.0
_MOST_KB: Final = 100.0
_TOGETHER: Final = 128
_FRAMES: Final = 2
_START: Final = 1_790_000_000_000_000_000


def measure_fleet(folder: Path, *, nodes: int, seconds: float) -> list[Row]:
    """So many nodes over TLS, each with a certificate of its own, with the whole stack beside.

    CPU is the processes' own, user and system, over the time measured. Memory is what each further
    node costs a fleet that is connected and has nothing to say.
    """
    with RealStack(folder) as stack:
        few = max(1, nodes // 20)
        sizes = few, max(few + 1, nodes // 4)
        enrolled = time.perf_counter()
        names = RunningFleet(folder / "names", stack.pki, port=1, count=nodes).names
        enrol(stack.identities, names)
        took = time.perf_counter() - enrolled
        idle = [_idle_memory(stack, folder / f"idle-{size}", size) for size in sizes]
        each = (idle[1] - idle[0]) / (sizes[1] - sizes[0]) / 1e3
        fleet = RunningFleet(
            folder / "fleet",
            stack.pki,
            port=stack.broker.node_port,
            count=nodes,
            sampling=_SAMPLING_HZ,
            stimulus=0.2,
            stretch_ms=_STRETCH_MS,
            status=_STATUS_S,
        )
        with fleet:
            _wait_for_all(fleet, nodes)
            time.sleep(_SETTLE_S)
            rows = _flow(stack, fleet, nodes, seconds)
        return [
            *rows,
            Row(
                "memory of an idle node of a fleet", each, "kB", "at most", _MOST_KB,
                _MOST_KB / each, 1.0, each < _MOST_KB,
            ),
            Row("enrolment of a node of a fleet", took / nodes * 1e3, "ms"),
        ]  # fmt: skip


def _wait_for_all(fleet: RunningFleet, nodes: int) -> None:
    done = f"connected: nodes={nodes} of={nodes}"
    fleet.wait_for(lambda: done in fleet.output(), f"{nodes} nodes connected", seconds=180)


def _idle_memory(stack: RealStack, folder: Path, nodes: int) -> float:
    """Resident bytes of a fleet that is connected and introduced."""
    fleet = RunningFleet(
        folder,
        stack.pki,
        port=stack.broker.node_port,
        count=nodes,
        sampling=_IDLE_HZ,
        stimulus=_IDLE_HZ,
        stretch_ms=_STRETCH_MS,
        status=_STATUS_S,
    )
    with fleet:
        _wait_for_all(fleet, nodes)
        time.sleep(1.0)
        assert fleet.process is not None
        return float(psutil.Process(fleet.process.pid).memory_info().rss)


def _flow(stack: RealStack, fleet: RunningFleet, nodes: int, seconds: float) -> list[Row]:
    parts: dict[str, Running] = {
        "the fleet": fleet,
        "Mosquitto": stack.broker,
        "the gateway": stack.gateway,
        "the cloud": stack.cloud,
    }
    before = {name: cpu_seconds(part) for name, part in parts.items()}
    messages, begun = stored_messages(stack), time.perf_counter()
    time.sleep(seconds)
    stored, took = stored_messages(stack) - messages, time.perf_counter() - begun
    spent = {name: cpu_seconds(part) - before[name] for name, part in parts.items()}
    rate = stored / took
    return [
        Row(
            f"messages of {nodes} nodes stored", rate, "messages/s", target=float(nodes),
            met=rate >= nodes,
        ),
        Row(f"processors that {nodes} nodes and the stack use", sum(spent.values()) / took, ""),
        *(
            Row(f"CPU of {name} a message, {nodes} nodes", used / max(1, stored) * 1e6, "us")
            for name, used in spent.items()
        ),
    ]  # fmt: skip


def measure_emulation(folder: Path, *, nodes: int) -> list[Row]:
    """Physics and firmware of nodes with three taxels at 100 Hz, up to the messages' bytes.

    Two threads share the nodes; nothing is stored or sent.
    """
    settings = _fingertips(folder)
    members = [RosterEntry(seed=number, boot=1, start=_START) for number in range(nodes)]
    cohorts = [
        Cohort(Roster(settings, members[first : first + _TOGETHER]))
        for first in range(0, nodes, _TOGETHER)
    ]
    frame = max(taxel.next.end for taxel in cohorts[0].taxels)
    with ThreadPoolExecutor(2) as pool:
        halves = [cohorts[0::2], cohorts[1::2]]
        list(pool.map(_run, halves, [frame] * 2))
        begun, used = time.perf_counter(), time.process_time()
        messages = sum(pool.map(_run, halves, [(1 + _FRAMES) * frame] * 2))
        took, used = time.perf_counter() - begun, time.process_time() - used
    emulated = _FRAMES * frame / 1e9
    factor = emulated / took
    name = f"{nodes} nodes of 3 taxels at 100 Hz: emulated in real seconds"
    return [
        Row(name, factor, "s/s", target=1.0, met=factor >= 1.0),
        Row("the same in a second of one processor", emulated / used, "s/s"),
        Row("messages made in it", messages / took, "1/s"),
    ]


def _fingertips(folder: Path) -> NodeSettings:
    taxels = [{**taxel, "sampling_Hz": 100.0} for taxel in Profile.read("fingertip").taxels]
    return NodeSettings.model_validate({
        "node": {"name": "fingertip", "profile": "bench"},
        "identity": {"directory": folder, "site": folder},
        "flash": {"path": folder / "flash.sqlite"},
        "truth": {"path": folder / "truth.sqlite"},
        "taxel": taxels,
        "sampling": {"stretch_ms": 1000.0},
    })  # fmt: skip


def _run(cohorts: Sequence[Cohort], ticks: int) -> int:
    messages = 0
    for cohort in cohorts:
        while cohort.next_due <= ticks:
            for _ in cohort.advance(cohort.next_due):
                pass
            messages += sum(1 for _ in cohort.flush())
    return messages
