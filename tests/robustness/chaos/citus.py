"""The database as a Citus cluster: a coordinator and workers, between which shards move."""

from __future__ import annotations

import secrets
import tempfile
import threading
import time
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Final, Unpack

import psycopg
from eskin_cloud.store.distribute import check, distribute

from eskin.errors import StoreError
from eskin.identity.identity import ROOT_FILE
from eskin.wire.slot import SLOTS, slot_of
from tests.robustness.chaos.database import Server
from tests.robustness.chaos.faults import DATABASE, WORKERS
from tests.support.citus import create_database, server_settings
from tests.support.postgresql import ADMIN

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from eskin.identity import Identity
    from tests.robustness.chaos.hosts import Host
    from tests.robustness.chaos.part import Around, Part

_SKIN: Final = "skin"
_FIRST_PORT: Final = 5433
_MOVE_S: Final = 120.0
_ELSEWHERE: Final = b"""
SELECT s.shard, n.nodeport FROM (
    SELECT slot, get_shard_id_for_distribution_column('feed', slot) AS shard
    FROM generate_series(0, %(last)s) AS slot
) AS s JOIN pg_dist_placement AS p ON p.shardid = s.shard JOIN pg_dist_node AS n USING (groupid)
WHERE n.nodeport <> %(port)s ORDER BY s.slot = ANY(%(slots)s) DESC, s.shard
"""
"""The shards of the other workers; first those that have rows of our nodes."""
_MOVE: Final = b"SELECT citus_move_shard_placement(%s, %s, %s, %s, %s, 'force_logical')"


class ShardMover:
    """Moves one shard after the other, in a thread, whatever befalls the servers.

    Args:
        coordinator: The coordinator.
        sockets: Folder of the sockets by which the servers meet.
        nodes: The nodes whose shards move before others.

    Attributes:
        moved: How many have moved.
        failed: Why others have not.
    """

    def __init__(self, coordinator: Server, sockets: Path, nodes: Sequence[str]) -> None:
        self._coordinator = coordinator
        self._sockets = str(sockets)
        self._slots = sorted({slot_of(node) for node in nodes})
        self._turns = count()
        self._thread: threading.Thread | None = None
        self.moved = 0
        self.failed: list[str] = []

    def take(self, port: int) -> None:
        """Begin to move a shard to a worker, unless another one is moving still."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = threading.Thread(target=self._try_to_move, args=(port,), daemon=True)
            self._thread.start()

    def settle(self) -> None:
        """Wait for the last move."""
        if self._thread is not None:
            self._thread.join(_MOVE_S)
            assert not self._thread.is_alive(), f"a shard moves for more than {_MOVE_S:g} s"

    def _try_to_move(self, port: int) -> None:
        try:
            with psycopg.connect(
                self._coordinator.cluster.words(_SKIN), autocommit=True
            ) as connection:
                self._move(connection, port)
        except psycopg.Error as error:
            self.failed.append(str(error).partition("\n")[0])
        else:
            self.moved += 1

    def _move(self, connection: psycopg.Connection, port: int) -> None:
        # It does nothing where the worker has joined before.
        connection.execute(b"SELECT citus_add_node(%s, %s)", (self._sockets, port))
        connection.execute(b"SELECT replicate_reference_tables('force_logical')")
        words = {"last": SLOTS - 1, "port": port, "slots": self._slots}
        found = connection.execute(_ELSEWHERE, words).fetchall()
        shard, source = found[next(self._turns) % len(self._slots)]
        connection.execute(_MOVE, (shard, self._sockets, source, self._sockets, port))


class Worker(Server):
    """A worker, which only the other servers reach, by a Unix socket.

    Args:
        name: Its name.
        host: Where it runs.
        folder: Takes its log.
        programs: Folder of the server's programs.
        sockets: Folder of the sockets by which the servers meet.
        port: Names its socket.
        mover: Moves shards to it.
        around: As of any part.
    """

    def __init__(
        self,
        name: str,
        *,
        host: Host,
        folder: Path,
        programs: Path,
        sockets: Path,
        port: int,
        mover: ShardMover,
        **around: Unpack[Around],
    ) -> None:
        super().__init__(
            name,
            host=host,
            folder=folder,
            programs=programs,
            sockets=sockets,
            settings=server_settings(sockets, port),
            **around,
        )
        self._mover = mover

    def take_shard(self) -> None:
        """Have a shard of another worker moved to it."""
        self._mover.take(self.cluster.port)


class DistributedDatabase:
    """The clouds come to the coordinator by TLS, over a cable; the servers meet by Unix sockets.

    Args:
        identity: The coordinator's.
        hosts: Of the coordinator, then of the workers.
        folder: Takes logs, and what the clouds need to come to the coordinator.
        programs: Folder of the programs of a PostgreSQL with Citus.
        nodes: The nodes whose shards move.
        around: As of any part.

    Attributes:
        coordinator: Its first part.
        workers: Its other parts; the last one has joined no cluster yet.
        mover: Moves shards between them.
        place: The store, as the judge comes to it.
        settings: The section ``store`` of the clouds' settings.
    """

    def __init__(
        self,
        identity: Identity,
        hosts: Sequence[Host],
        *,
        folder: Path,
        programs: Path,
        nodes: Sequence[str],
        **around: Unpack[Around],
    ) -> None:
        # None of the servers' disks has the sockets: one that is full lets the others start.
        self._sockets = tempfile.TemporaryDirectory(prefix="citus-")
        sockets = Path(self._sockets.name)
        sockets.chmod(0o1777)
        ports: Iterator[int] = count(_FIRST_PORT)
        self.coordinator = Server(
            DATABASE,
            host=hosts[0],
            folder=folder,
            identity=identity,
            programs=programs,
            sockets=sockets,
            settings=server_settings(sockets, 0),
            **around,
        )
        self.mover = ShardMover(self.coordinator, sockets, nodes)
        self.workers = [
            Worker(
                name,
                host=host,
                folder=folder,
                programs=programs,
                sockets=sockets,
                port=next(ports),
                mover=self.mover,
                **around,
            )
            for name, host in zip(WORKERS, hosts[1:], strict=True)
        ]
        self.place = self.coordinator.cluster.place(_SKIN)
        self._password = folder / "database.password"
        address = f"{hosts[0].address}:{self.coordinator.cluster.port}"
        self.settings: dict[str, object] = {
            "url": f"postgresql://{ADMIN}@{address}/{_SKIN}",
            "password_file": self._password,
            "root": identity.directory / ROOT_FILE,
        }

    @property
    def parts(self) -> Sequence[Part]:
        """Its parts."""
        return [self.coordinator, *self.workers]

    def start(self) -> None:
        """Start all servers, and distribute an empty store over all workers but the last."""
        sockets, main = self._sockets.name, self.coordinator.cluster
        for server in (self.coordinator, *self.workers):
            server.cluster.start()
            create_database(server.cluster, _SKIN)
        self._password.write_text(secrets.token_hex())
        words = [
            f"ALTER ROLE {ADMIN} PASSWORD '{self._password.read_text()}'",
            f"SELECT citus_set_coordinator_host('{sockets}', {main.port})",
            *(
                f"SELECT citus_add_node('{sockets}', {worker.cluster.port})"
                for worker in self.workers[:-1]
            ),
        ]
        for statement in words:
            main.execute(statement, database=_SKIN)
        distribute(self.place, now=time.time_ns())

    def close(self) -> None:
        """Remove the folder of the sockets."""
        self._sockets.cleanup()

    def wrong(self) -> list[str]:
        """What is wrong with the cluster at the end."""
        faults = []
        if self.mover.failed and not self.mover.moved:
            faults.append(f"no shard has moved: {self.mover.failed[-1]}")
        try:
            check(self.place)
        except StoreError as error:
            faults.append(str(error))
        return faults
