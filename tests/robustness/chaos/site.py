"""The real stack on hosts of its own: Mosquitto, two gateways that share a load, clouds, nodes.

Where the store is on a server: PostgreSQL, too, or a cluster of it that Patroni looks after, or
one of Citus.
"""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from contextlib import ExitStack
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

from eskin_cloud.access import Scope, create_token
from eskin_cloud.store import Store

from eskin.demo.layout import DemoFolder
from eskin.identity import IdentityKind
from eskin.identity.identity import CHAIN_FILE
from eskin.mosquitto import BrokerPorts
from eskin.wire.sequence_set import SequenceRanges
from tests.robustness.chaos.alarms import define
from tests.robustness.chaos.citus import DistributedDatabase
from tests.robustness.chaos.clocks import Wallclock, build_library
from tests.robustness.chaos.database import Database, DatabaseCluster
from tests.robustness.chaos.disks import Disk
from tests.robustness.chaos.faults import DATABASE, MEMBERS, WORKERS
from tests.robustness.chaos.hosts import Host, make_switch
from tests.robustness.chaos.part import INSIDER, Around, Part
from tests.robustness.chaos.recorder import (
    read_events,
    record_flash,
    record_spool,
    record_store,
)
from tests.support.brokers import mosquitto, write_configuration
from tests.support.files import ask, write_settings
from tests.support.identities import Identities
from tests.support.processes import ESKIN, Running, wait_until
from tests.support.skin_watcher import Seen
from tests.support.stores import ask_store

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

    from eskin_cloud.store.location import StoreLocation

    from eskin.identity import Identity
    from tests.robustness.model.traces import Event

SKIN: Final = "small-hand"
"""A node of 336 taxels, which sends frames and is watched."""
NODES: Final = ("fingertip", "palm", "forearm", SKIN)
GATEWAYS: Final = ("gateway-1", "gateway-2")
CLOUDS: Final = ("cloud", "cloud-2", "cloud-3")
STORES: Final = {"sqlite": 1, "postgresql": 2, "cluster": 3, "citus": 3}
"""What keeps the store, and how many clouds are on it: an SQLite file serves one alone."""
_ETCD: Final = "etcd"
_PORTS: Final = BrokerPorts(nodes=8883, gateways=8884, clients=8885)
_INGEST: Final = 8443
_PEOPLE: Final = 8080
_RECEIVER: Final = 8090
_MEBIBYTE: Final = 1 << 20
_NO_STORE: Final = ": the store cannot be "
"""In a cloud's last line where it found no database when it started."""
_NO_FLASH: Final = ": flash cannot be opened: "
"""In a node's where its disk was full."""


class Site:
    """All parts, in a data folder that `eskin audit` understands.

    Args:
        root: The folder.
        kind: What keeps the store, of `STORES`.
        programs: Folder of the programs of a PostgreSQL with Citus, where that keeps the store.

    Attributes:
        store: Where the cloud's store is.
        seen: What the skin's watcher saw, once it watches.
        taken: What the receiver of alarms took.
        watcher: Its process.
        unwatched: By boot, the numbers of the skin's messages that were stored when it began.
    """

    def __init__(self, root: Path, *, kind: str = "sqlite", programs: Path | None = None) -> None:
        self.layout = DemoFolder(root)
        self._logs = self.layout.logs
        self._logs.mkdir(parents=True)
        self._library = build_library(root)
        self._exits = ExitStack()
        make_switch()
        hosts = self._hosts = {
            name: Host(name, number)
            for number, name in enumerate((*part_names(kind), _ETCD), start=1)
        }
        self._identities = Identities(root / "identities")
        self.database = self._make_database(kind, programs)
        self.store: StoreLocation = (
            self.layout.store if self.database is None else self.database.place
        )
        self.broker = self._make_broker(hosts["broker"])
        self.clouds = [self._make_cloud(hosts[name]) for name in CLOUDS[: STORES[kind]]]
        self.gateways = [
            self._make_gateway(hosts[name], number) for number, name in enumerate(GATEWAYS, start=1)
        ]
        self.nodes = [self._make_node(hosts[name]) for name in NODES]
        self.seen = root / "seen"
        self.taken = root / "taken"
        self.watcher: Running | None = None
        self.unwatched: dict[int, SequenceRanges] = {}

    @property
    def parts(self) -> list[Part]:
        """All of them, in the order of their start."""
        first = [] if self.database is None else self.database.parts
        return [*first, self.broker, *self.clouds, *self.gateways, *self.nodes]

    @property
    def served(self) -> list[str]:
        """Names of those that run until the end; nodes end before."""
        return [part.name for part in self.parts if part not in self.nodes]

    def part(self, name: str) -> Part:
        """One of them."""
        return next(part for part in self.parts if part.name == name)

    def __enter__(self) -> Self:
        for part in self.parts:
            self._exits.callback(part.close)
        if isinstance(self.database, DatabaseCluster):
            self._exits.callback(_end, self.database.etcd)
        if isinstance(self.database, DistributedDatabase):
            self._exits.callback(self.database.close)
        for part in self.parts:
            self._exits.callback(_end, part.running)
            self._exits.callback(part.calm)
        stored: Sequence[Part] = []
        if self.database is not None:
            self.database.start()
            stored = self.database.parts
        for part in self.parts:
            if part not in stored:
                part.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._exits.close()

    def require_alive(self, names: Sequence[str]) -> None:
        """Check that these have not ended by themselves.

        A cloud that finds no database when it starts, and a node whose disk is full then, end with
        a line that says so, and what looks after them starts them again, as `docker-compose.yml`
        has it.

        Raises:
            AssertionError: One has; shows the end of its log.
        """
        for name in names:
            running = self.part(name).running
            assert running.process is not None
            status = running.process.poll()
            if status is None:
                continue
            last = running.output()[-3000:]
            lacked = self.database is not None and name in CLOUDS and _NO_STORE in last[-2000:]
            lacked |= name in NODES and _NO_FLASH in last[-2000:]
            assert status == 2 and lacked, f"{name} ended with {status}:\n{last}"  # noqa: PT018 - one condition
            running.start()

    def has_begun(self) -> bool:
        """Whether frames of all nodes are stored."""
        if not self.store_is_made():
            return False
        return bool(
            ask_store(self.store, "SELECT count(DISTINCT node) FROM pages")[0][0] >= len(NODES)
        )

    def record(self) -> None:
        """Record from now on what becomes of frames."""
        assert isinstance(self.store, Path)
        record_store(self.store)
        for name in GATEWAYS:
            record_spool(self._spool(name))
        for node in NODES:  # last, so that all that is made from now on is recorded on its way
            record_flash(self.layout.flash(node))

    def recorded(self) -> list[Event]:
        """What became of frames since."""
        assert isinstance(self.store, Path)
        return read_events(
            flashes={node: self.layout.flash(node) for node in NODES},
            spools={name: self._spool(name) for name in GATEWAYS},
            store=self.store,
            now=time.time(),
        )

    def watch(self) -> None:
        """Have the skin watched beside the first cloud, until the end.

        Returns once the stream has begun: what is stored from then on is to be seen.
        """
        with Store(self.store) as store:
            token = create_token(
                store, name="watcher", scopes=[Scope.READ], lifetime=timedelta(days=1)
            )
        words = ["-m", "tests.support.skin_watcher", str(_PEOPLE), SKIN, str(self.seen)]
        argv = [*self.clouds[0].host.prefix, sys.executable, *words]
        self.watcher = Running(argv, log=self._logs / "watcher.log", env={"ESKIN_TOKEN": token})
        self._exits.callback(_end, self.watcher)
        self.watcher.start()
        wait_until(lambda: Seen.read(self.seen).begun, "the skin's stream has begun", seconds=60)
        self.unwatched = self.numbers(SKIN)

    def numbers(self, node: str) -> dict[int, SequenceRanges]:
        """By boot, the numbers of a node's messages that are stored."""
        found: dict[int, SequenceRanges] = defaultdict(SequenceRanges)
        query = f"SELECT boot, first, last FROM sequences WHERE node = '{node}'"  # noqa: S608 - our words
        for boot, first, last in ask_store(self.store, query):
            found[boot].add(first, last)
        return found

    def raise_alarms(self, *, seed: int) -> None:
        """Have a cloud evaluate monitors, and receivers beside all of them take their alarms."""
        words = ["-m", "tests.support.alarm_receiver", str(_RECEIVER), str(self.taken), str(seed)]
        for cloud in self.clouds:  # the one that leads at the time delivers
            argv = [*cloud.host.prefix, sys.executable, *words]
            receiver = Running(argv, log=self._logs / f"receiver-{cloud.name}.log")
            self._exits.callback(_end, receiver)
            receiver.start()
        define(self.store)

    def store_is_made(self) -> bool:
        """Whether the cloud made its tables."""
        tables = "sqlite_master" if isinstance(self.store, Path) else "pg_tables"
        name = "name" if isinstance(self.store, Path) else "tablename"
        query = f"SELECT count(*) FROM {tables} WHERE {name} = 'events'"  # noqa: S608 - our words
        return any(row[0] for row in ask_store(self.store, query))

    def waiting(self) -> dict[str, int]:
        """Messages that wait in each flash and each spool."""
        flashes = {node: self.layout.flash(node) for node in NODES}
        counts = {node: self._count(path, "message") for node, path in flashes.items()}
        for name in GATEWAYS:
            counts[name] = self._count(self._spool(name), "messages")
        return counts

    def letters(self) -> list[str]:
        """What a gateway or the cloud refused to take."""
        query = "SELECT node || ': ' || reason FROM dead_letters"
        letters = list(ask_store(self.store, query))
        for name in GATEWAYS:
            letters += ask(self._spool(name), query)
        return [row[0] for row in letters]

    def drain(self, *, seconds: float) -> None:
        """End the nodes, which hand over what their flash holds, then wait until all has arrived.

        A node that has no connection when it is to end keeps what it has for its next start.

        Raises:
            AssertionError: Something waits, and for so long nothing of it has arrived.
        """
        if isinstance(self.database, DistributedDatabase):
            self.database.mover.settle()
        for part in self.nodes:
            part.running.stop(seconds=seconds)
            while self._count(self.layout.flash(part.name), "message"):
                last = self._last_boot(part.name)
                part.running.start()
                self._wait_until_stated(part.name, last, seconds)
                part.running.stop(seconds=seconds)
        while before := self._still_waiting():
            less = partial(self._is_less, before)
            wait_until(less, f"less waits than {self.waiting()}", seconds=seconds)

    def _still_waiting(self) -> int:
        return sum(self.waiting().values())

    def _is_less(self, before: int) -> bool:
        self.require_alive(self.served)
        return self._still_waiting() < before

    def _last_boot(self, node: str) -> int:
        query = "SELECT boot FROM member"
        return int(ask(self.layout.flash(node), query)[0][0])

    def _wait_until_stated(self, node: str, boot: int, seconds: float) -> None:
        """Wait until what a node said up to a boot has left its flash, which another boot does."""
        query = f"SELECT count(*) FROM message WHERE boot <= {boot}"  # noqa: S608 - a number

        def stated() -> bool:
            self.require_alive(self.served)
            return bool(ask(self.layout.flash(node), query)[0][0] == 0)

        what = f"what {node} said before its last start arrives"
        wait_until(stated, what, seconds=seconds)

    def _count(self, path: Path, table: str) -> int:
        rows = ask(path, f"SELECT count(*) FROM {table}")  # noqa: S608 - our own words
        return int(rows[0][0]) if rows else 0

    def _spool(self, name: str) -> Path:
        return self.layout.root / name / "spool.sqlite"

    def _make_broker(self, host: Host) -> Part:
        folder = self.layout.root / "broker"
        disk = Disk(folder, 64 * _MEBIBYTE)
        server = self._identities.make(IdentityKind.SERVER, "server.broker", hosts=(host.address,))
        file = write_configuration(
            folder, self._identities, server, host=host.address, ports=_PORTS
        )
        with file.open("a") as config:
            config.write(f"\nlistener {INSIDER} 127.0.0.1\nallow_anonymous true\n")
        return self._part("broker", [str(mosquitto()), "-c", str(file)], host, disk, server)

    def _make_database(
        self, kind: str, programs: Path | None
    ) -> Database | DatabaseCluster | DistributedDatabase | None:
        names = database_names(kind)
        if not names:
            return None
        hosts = [self._hosts[name] for name in names]
        servers = [
            self._identities.make(IdentityKind.SERVER, f"server.{host.name}", hosts=(host.address,))
            for host in hosts
            if host.name not in WORKERS
        ]
        around = self._around(DATABASE)
        if kind == "postgresql":
            return Database(servers[0], host=hosts[0], folder=self._logs, **around)
        if programs is not None:
            return DistributedDatabase(
                servers[0], hosts, folder=self._logs, programs=programs, nodes=NODES, **around
            )
        return DatabaseCluster(servers, hosts, self._hosts[_ETCD], folder=self._logs, **around)

    def _make_cloud(self, host: Host) -> Part:
        first = host.name == CLOUDS[0]
        folder = self.layout.store.parent if first else self.layout.root / host.name
        disk = Disk(folder, (2048 if first else 64) * _MEBIBYTE)
        name = f"server.{host.name}"
        server = self._identities.make(IdentityKind.SERVER, name, hosts=(host.address,))
        store: dict[str, object] = {"path": self.store}
        config = write_settings(self.layout.root / f"{host.name}.toml", {
            "store": store if self.database is None else self.database.settings,
            "people": {"port": _PEOPLE},
            "gateways": {"host": host.address, "port": _INGEST, "identity": server.directory},
            "alarms": {"timeout_s": 2.0, "retry_max_s": 2.0},
            "alarms.webhooks": {"ops": f"http://127.0.0.1:{_RECEIVER}/"},
        })  # fmt: skip
        argv = [ESKIN, "cloud", "--config", str(config)]
        return self._part(host.name, argv, host, disk, server)

    def _make_gateway(self, host: Host, number: int) -> Part:
        spool = self._spool(host.name)
        urls = [f"https://{each.host.address}:{_INGEST}/api/v1/ingest" for each in self.clouds]
        disk = Disk(spool.parent, 256 * _MEBIBYTE)
        own = self._identities.make(IdentityKind.GATEWAY, f"gateway.g{number}")
        config = write_settings(self.layout.root / f"{host.name}.toml", {
            "broker": {"host": self.broker.host.address, "port": _PORTS.gateways, "group": "site",
                       "keepalive_s": 5},
            "identity": {"directory": own.directory, "site": self._identities.site.directory},
            "cloud": {"url": urls[0], "fallbacks": urls[1:],
                      "timeout_s": 3.0, "retry_max_s": 2.0},
            "spool": {"path": spool},
        })  # fmt: skip
        argv = [ESKIN, "gateway", "--config", str(config)]
        return self._part(host.name, argv, host, disk, own, self._identities.site)

    def _make_node(self, host: Host) -> Part:
        name = host.name
        flash = self.layout.node(name) / "chip" / "flash.sqlite"
        disk = Disk(flash.parent, 96 * _MEBIBYTE)
        self.layout.flash(name).symlink_to(flash)
        own = self._identities.node
        if name != own.name:
            own = self._identities.make(IdentityKind.NODE, name)
        config = write_settings(self.layout.node_settings(name), {
            "node": {"name": name, "profile": name, "seed": 1},
            "sampling": {"stretch_ms": 50.0, "overrun_s": 3.0},
            "broker": {"host": self.broker.host.address, "port": _PORTS.nodes, "keepalive_s": 5,
                       "resend_s": 2.0, "drain_s": 60.0},
            "identity": {"directory": own.directory,
                         "site": self._identities.site.directory / CHAIN_FILE},
            "flash": {"path": flash, "capacity_bytes": 32 * _MEBIBYTE},
            "truth": {"path": self.layout.truth(name), "limit_bytes": 4096 * _MEBIBYTE},
        })  # fmt: skip
        return self._part(name, [ESKIN, "node", "--config", str(config)], host, disk, own)

    def _part(
        self, name: str, argv: Sequence[str], host: Host, disk: Disk, *identities: Identity
    ) -> Part:
        clock = Wallclock(self.layout.root / f"{name}.clock", self._library)
        log = self._logs / f"{name}.log"
        return Part(
            name,
            Running([*host.prefix, *argv], log=log, env=clock.environment),
            host=host,
            disk=disk,
            clock=clock,
            identities=[own.directory for own in identities],
            **self._around(name),
        )

    def _around(self, name: str) -> Around:
        return {
            "authority": self._identities.authority,
            "attacker": self._hosts["broker"].prefix,
            "beside": self._logs / f"{name}-attacker.log",
        }


def database_names(kind: str) -> tuple[str, ...]:
    """Names of the parts that are the database."""
    servers = {"postgresql": (DATABASE,), "cluster": MEMBERS, "citus": (DATABASE, *WORKERS)}
    return servers.get(kind, ())


def part_names(kind: str) -> tuple[str, ...]:
    """Names of all parts of a site."""
    return ("broker", *CLOUDS[: STORES[kind]], *GATEWAYS, *NODES, *database_names(kind))


def _end(running: Running) -> None:
    if running.process is not None and running.process.poll() is None:
        running.kill()
