"""A Citus cluster of the tests' own: a coordinator and workers that meet by Unix sockets."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Final

from eskin_cloud.store.distribute import distribute

from tests.support.postgresql import Cluster

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from types import TracebackType

    from sqlalchemy import URL

REPOSITORY: Final = Path(__file__).parents[2]
SOURCE: Final = "ESKIN_CITUS_SOURCE"
"""In the environment: Citus's source tree, of which it is built."""
PROGRAMS: Final = "ESKIN_CITUS_PROGRAMS"
"""In the environment: folder of the programs of a PostgreSQL with Citus that was built before."""
NO_SOURCE: Final = "no source tree of Citus is given: SOURCE=DIR, DIR a checkout of v13.0.5"
_FIRST_PORT: Final = 5432
"""Ports only name the sockets in the cluster's folder: no server listens to a network."""


def build(source: Path) -> tuple[Path, Path]:
    """Build Citus by the script that is shipped, into a copy of PostgreSQL.

    Args:
        source: Citus's source tree.

    Returns:
        The copy, which the caller removes, and the folder of the server's programs in it.
    """
    copy = Path(tempfile.mkdtemp(prefix="citus-"))
    copy.chmod(0o755)  # a server that root starts runs as another user
    script = REPOSITORY / "services" / "citus" / "build.sh"
    words = [script, source, copy / "postgresql"]
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, timeout=1800, check=False)
    assert done.returncode == 0, "Citus was not built; see above"
    return copy, Path(done.stdout.splitlines()[-1])


@contextmanager
def citus_programs() -> Iterator[Path | None]:
    """The folder of the programs of a PostgreSQL with Citus; ``None`` if the environment has none.

    What is built for it is removed at the end.
    """
    built, source = os.environ.get(PROGRAMS), os.environ.get(SOURCE)
    if built or not source:
        yield Path(built) if built else None
        return
    copy, folder = build(Path(source).resolve())
    try:
        yield folder
    finally:
        shutil.rmtree(copy)


def server_settings(sockets: Path, port: int) -> dict[str, str]:
    """Settings of a server of a cluster.

    Args:
        sockets: Folder of the sockets by which the servers meet.
        port: Names the server's socket.
    """
    return {
        "shared_preload_libraries": "citus",
        "wal_level": "logical",  # by which a shard moves while it is written
        "max_prepared_transactions": "200",
        "max_connections": "200",
        "citus.max_adaptive_executor_pool_size": "1",  # as services/citus/citus.conf has it
        # Citus has one for each database of the tests, and each move needs some.
        "max_worker_processes": "64",
        "port": str(port),
        "citus.local_hostname": str(sockets),
    }


def create_database(server: Cluster, name: str) -> None:
    """Make a database with Citus at one server."""
    server.execute(f"CREATE DATABASE {name}", database="postgres")
    server.execute("CREATE EXTENSION citus", database=name)


class CitusCluster(Cluster):
    """A coordinator; its workers are servers of their own.

    Args:
        programs: Folder of a server's programs, with Citus.
        workers: How many there are at first.
        settings: More settings of each server.
        prefix: Words before the command of each server.
    """

    def __init__(
        self,
        programs: Path,
        *,
        workers: int = 2,
        settings: Mapping[str, str] | None = None,
        prefix: Sequence[str] = (),
    ) -> None:
        self._programs = programs
        self._prefix = prefix
        self._settings = dict(settings or {})
        self._ports = count(_FIRST_PORT)
        self._databases = count(1)
        self.folder = Path(tempfile.mkdtemp(prefix="citus-"))
        settings = self._shared(next(self._ports))
        super().__init__(folder=self.folder, prefix=prefix, programs=programs, settings=settings)
        self.workers: list[Cluster] = [self._new_worker() for _ in range(workers)]

    def _shared(self, port: int) -> dict[str, str]:
        return {**server_settings(self.folder, port), **self._settings}

    def _new_worker(self) -> Cluster:
        port = next(self._ports)
        folder = self.folder / f"worker-{port}"
        folder.mkdir()
        return Cluster(
            folder=folder,
            prefix=self._prefix,
            programs=self._programs,
            sockets=self.folder,
            settings=self._shared(port),
        )

    def prepare(self) -> None:
        """Start the workers; databases are made one by one, with all that Citus keeps of them."""
        for worker in self.workers:
            worker.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # What they hold goes with the folder: no server needs to write it out.
        for server in (*self.workers, self):
            if server.running.process is not None and server.running.process.poll() is None:
                server.running.kill()
        super().__exit__(kind, error, trace)

    def fresh(self, *, empty: bool = False) -> URL:
        """A database of its own, with its workers: a distributed store, or without any table."""
        name = f"store_{next(self._databases)}"
        create_database(self, name)
        self.execute(
            f"SELECT citus_set_coordinator_host('{self.folder}', {self.port})", database=name
        )
        for worker in self.workers:
            self._add(worker, name)
        place = self.place(name)
        if not empty:
            distribute(place, now=time.time_ns())
        return place

    def start_worker(self, place: URL) -> Cluster:
        """Start one more worker, and add it to a database's cluster; it has no shard yet."""
        worker = self._new_worker()
        self.workers.append(worker)
        worker.start()
        self._add(worker, str(place.database))
        return worker

    def name_of(self, worker: Cluster) -> str:
        """A server's name within the cluster."""
        return f"{self.folder}:{worker.port}"

    def _add(self, worker: Cluster, database: str) -> None:
        create_database(worker, database)
        self.execute(f"SELECT citus_add_node('{self.folder}', {worker.port})", database=database)
