"""A fleet as a process: ``eskin node --count N``."""

from __future__ import annotations

import logging
import resource
import threading
import time
from typing import TYPE_CHECKING, Final

from eskin.errors import IdentityError, SettingsError
from eskin.identity import numbered
from eskin.runtime.stop_signals import stop_on_signals
from eskin_sensor_node.fleet.cohort import Cohort
from eskin_sensor_node.fleet.connection import Connection
from eskin_sensor_node.fleet.connector import Connector
from eskin_sensor_node.fleet.fleet import Fleet
from eskin_sensor_node.fleet.member import Member
from eskin_sensor_node.fleet.roster import Roster, RosterEntry
from eskin_sensor_node.fleet.shard import Shard
from eskin_sensor_node.fleet.single_node import reason_to_sample_alone
from eskin_sensor_node.kinds.neighbours import measured_around
from eskin_sensor_node.link.keys import NodeKeys
from eskin_sensor_node.machine.budget import require_ram
from eskin_sensor_node.machine.flash.file import FlashFile
from eskin_sensor_node.machine.processor import require_speed
from eskin_sensor_node.node.factory import REBOOT, chip_key
from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.settings import RadioSection

if TYPE_CHECKING:
    from eskin_sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)

_SPARE_FILES: Final = 64
_MOST_PER_SHARD: Final = 128
"""Members that sample at the same instant; shards are spread over a frame."""
_FEWEST_SHARDS: Final = 8
_PROGRESS_S: Final = 2.0


def run(settings: NodeSettings) -> None:
    """Run until SIGTERM or SIGINT.

    Raises:
        FlashError: Storage or truth cannot be opened.
        IdentityError: A key or certificate cannot be used.
        PrivacyError: The key of the flash cannot be had.
        SettingsError: There cannot be so many connections, or a setting is none of a fleet.
    """
    stop = threading.Event()
    stop_on_signals(stop)
    if settings.skin.present:
        raise SettingsError("fleet.count", "a node with a skin runs alone; start one process each")
    _require_open_air(settings)
    require_ram(settings)
    require_speed(settings, measured_around(settings.taxel))
    require_files(settings.fleet.count)
    names = numbered(settings.node.name, settings.fleet.count)
    truth = GroundTruth(settings.truth.path, limit=settings.truth.limit_bytes)
    try:
        storage = FlashFile(settings.flash.path, names, key=chip_key(settings))
        try:
            _serve(settings, names, storage, truth, stop)
        finally:
            storage.close()
    finally:
        truth.close()


def _require_open_air(settings: NodeSettings) -> None:
    if settings.radio != RadioSection():
        raise SettingsError(
            "radio", "the members of a fleet have the network itself; leave this section out"
        )


def require_files(count: int) -> None:
    """Let this process have a socket for each member.

    Raises:
        SettingsError: The system does not allow so many.
    """
    wanted = count + _SPARE_FILES
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft >= wanted:
        return
    if hard != resource.RLIM_INFINITY and hard < wanted:
        raise SettingsError(
            "fleet.count",
            f"{count} nodes need {wanted} open files and this process may have {hard}; raise the "
            "hard limit (ulimit -Hn), or run several smaller fleets",
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def build_shards(
    settings: NodeSettings, names: list[str], storage: FlashFile, truth: GroundTruth
) -> list[Shard]:
    """Put a fleet's nodes together, spread over the time of one stretch."""
    seed = truth.seed(settings.node.seed)
    for name in names if settings.departures else ():
        truth.store_departures(name, settings.departures)
    size = max(1, min(_MOST_PER_SHARD, -(-len(names) // _FEWEST_SHARDS)))
    parts = -(-len(names) // size)
    now, begin = time.monotonic_ns(), _begin(truth, time.time_ns())
    shards = []
    for part in range(parts):
        delay = int(settings.sampling.stretch * part / parts / settings.node.speed)
        numbers = range(part * size, min(len(names), (part + 1) * size))
        shards.append(
            Shard(
                settings,
                [names[number] for number in numbers],
                numbers,
                seed=seed,
                storage=storage,
                truth=truth,
                start=begin + delay,
                origin=now + delay,
            )
        )
    return shards


def _begin(truth: GroundTruth, start: int) -> int:
    """Start after the latest sample, also where a fleet ran faster than real time."""
    end = truth.end()
    return start if end is None else max(start, end + REBOOT)


def _build_connections(settings: NodeSettings, names: list[str]) -> dict[str, Connection]:
    connections: dict[str, Connection] = {}
    logged = time.monotonic()
    for name in names:
        keys = NodeKeys(settings.identity.directory / name, settings.identity.site)
        if keys.own.name != name:
            raise IdentityError(f"{keys.own.directory}: this is {keys.own.name}, not {name}")
        connections[name] = Connection(keys, settings.broker)
        if time.monotonic() > logged + _PROGRESS_S:
            logged = time.monotonic()
            log.info("starting: identities=%d of=%d", len(connections), len(names))
    return connections


def warm_up(settings: NodeSettings) -> None:
    """Compile all kernels before the fleet starts."""
    alone = Cohort(Roster(settings, [RosterEntry(seed=0, boot=1, start=time.time_ns())]))
    latest = max(taxel.next.due for taxel in alone.taxels)
    for _ in alone.advance(latest):
        pass
    alone.finish()


def _serve(
    settings: NodeSettings,
    names: list[str],
    storage: FlashFile,
    truth: GroundTruth,
    stop: threading.Event,
) -> None:
    connector = Connector()
    connections = _build_connections(settings, names)
    warm_up(settings)
    shards = build_shards(settings, names, storage, truth)
    members = [
        Member(shard, row, connections[name], cloud=settings.identity.cloud)
        for shard in shards
        for row, name in enumerate(shard.names)
    ]
    fleet = Fleet(members, storage=storage, truth=truth, connector=connector)
    fleet.start()
    connector.start()
    alone = reason_to_sample_alone(settings)
    if alone is not None:
        log.info("all nodes sample alone: setting=%s", alone)
    log.info("running: nodes=%d first=%s last=%s", len(names), names[0], names[-1])
    online, logged = 0, time.monotonic()
    while not stop.is_set():
        try:
            fleet.turn()
        except Exception:  # the process's outermost loop
            fleet.failures += 1
            log.exception("turn failed, continuing: failures=%d", fleet.failures)
            stop.wait(1.0)
        if online < len(names) and time.monotonic() > logged + _PROGRESS_S:
            online, logged = fleet.online, time.monotonic()
            log.info("connected: nodes=%d of=%d", online, len(names))
    fleet.finish()
    deadline = time.monotonic() + settings.broker.drain_s
    while not fleet.drained and time.monotonic() < deadline:
        fleet.turn(sampling=False)
    connector.stop()
    fleet.close()
    log.info("stopped: nodes=%d waiting=%d", len(names), fleet.waiting)
