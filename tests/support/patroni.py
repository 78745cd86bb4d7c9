"""PostgreSQL members that Patroni looks after, with etcd: a primary and a synchronous standby."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import tempfile
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import httpx
import psutil
import psycopg
from eskin_cloud.store.location import parse_url

from eskin.demo.ports import free_ports
from eskin.identity.identity import CHAIN_FILE, KEY_FILE, ROOT_FILE
from tests.support.postgresql import as_another_user, program
from tests.support.processes import PLAIN, Running, wait_until

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import TracebackType

    from sqlalchemy import URL

    from eskin.identity import Identity

PATRONI: Final = Path(__file__).parents[2] / ".venv" / "patroni" / "bin" / "patroni"
ADMIN: Final = "eskin"
_REPLICATOR: Final = "replicator"
DYNAMIC: Final[Mapping[str, object]] = {
    "ttl": 20,
    "loop_wait": 2,
    "retry_timeout": 5,
    "primary_start_timeout": 0,
    "synchronous_mode": True,
    "postgresql": {"use_pg_rewind": True},
}
"""What Patroni keeps in etcd, as `docs/high-availability.md` has it."""


class Etcd(Running):
    """One member of etcd, which is enough for tests.

    Args:
        folder: Takes its data and its log.
        address: Where it listens.
        prefix: Words before its command.

    Attributes:
        clients: Where Patroni reaches it, as ``HOST:PORT``.
    """

    def __init__(
        self, folder: Path, *, address: str = "127.0.0.1", prefix: Sequence[str] = ()
    ) -> None:
        etcd = shutil.which("etcd")
        assert etcd is not None, "etcd is missing; install it (apt-get install etcd-server)"
        own, peers = free_ports(2)
        self.clients = f"{address}:{own}"
        url, peer = f"http://{self.clients}", f"http://{address}:{peers}"
        words = [etcd, "--name", "etcd", "--data-dir", str(folder / "etcd"),
                 "--listen-client-urls", url, "--advertise-client-urls", url,
                 "--listen-peer-urls", peer, "--initial-advertise-peer-urls", peer,
                 "--initial-cluster", f"etcd={peer}"]  # fmt: skip
        super().__init__([*prefix, *words], log=folder / "etcd.log")

    def __enter__(self) -> Self:
        self.begin()
        return self

    def begin(self) -> None:
        """Start it, and wait until it answers."""
        self.start()
        self.wait_for(lambda: "ready to serve client requests" in self.output(), "etcd is ready")


class Postgresql(Running):
    """The server of a member: its Patroni starts it, and starts it again.

    Args:
        data: Its data.
    """

    def __init__(self, data: Path) -> None:
        super().__init__([], log=data / "none")
        self._data = data

    def start(self) -> None:
        """Leave that to Patroni."""

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to its processes, of which SIGHUP is for the first alone."""
        processes = self._processes()
        for process in processes[:1] if number == signal.SIGHUP else processes:
            with suppress(psutil.NoSuchProcess):
                process.send_signal(number)

    def kill(self) -> None:
        """End it as a power cut would, if it runs."""
        self.signal(signal.SIGSTOP)  # and none is forked meanwhile
        processes = self._processes()
        for process in processes:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        _, alive = psutil.wait_procs(processes, timeout=30)
        assert not alive, alive

    def _processes(self) -> list[psutil.Process]:
        try:
            number = int((self._data / "postmaster.pid").read_text().split()[0])
            postmaster = psutil.Process(number)
            if Path(postmaster.cwd()) != self._data:
                return []  # another has the number now
            return [postmaster, *postmaster.children()]
        except (OSError, ValueError, IndexError, psutil.Error):
            return []


class Patroni(Running):
    """The Patroni of a member, without its server.

    Args:
        member: The member.
    """

    def __init__(self, member: Member) -> None:
        super().__init__(member.argv, log=member.log)
        self._member = member

    def start(self) -> None:
        """Start it again."""
        self._member.start()

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        assert self._member.process is not None
        self._member.process.send_signal(number)

    def kill(self) -> None:
        """End it as a power cut would."""
        assert self._member.process is not None
        self._member.process.kill()
        self._member.process.wait()


class Member(Running):
    """Patroni with its PostgreSQL server, which outlives it where it is killed alone.

    Args:
        name: Its name in the cluster.
        folder: Of another user, for its data and its socket.
        etcd: Where etcd is.
        address: Where both listen.
        identity: With which the server listens by TLS and for passwords; any local user else.
        prefix: Words before its command.
        log: Takes what Patroni says; a file in the folder else.

    Attributes:
        name: Its name.
        folder: Its folder.
        address: Where it listens.
        port: PostgreSQL's.
        postgresql: Its server alone.
        patroni: Its Patroni alone.
    """

    def __init__(
        self,
        name: str,
        folder: Path,
        etcd: str,
        *,
        address: str = "127.0.0.1",
        identity: Identity | None = None,
        prefix: Sequence[str] = (),
        log: Path | None = None,
    ) -> None:
        assert PATRONI.exists(), "Patroni is missing: run make .venv/patroni/.installed"
        self.name = name
        self.folder = folder
        self.address = address
        self.port, rest = free_ports(2)
        self._rest = f"{address}:{rest}"
        as_user = _as_another_user(folder) if os.geteuid() == 0 else []
        self._data = folder / "data"
        config = folder / "patroni.yml"
        config.write_text(json.dumps(self._settings(etcd, identity), indent=2))
        if identity is not None:
            self.show(identity)
        super().__init__(
            [*prefix, *as_user, str(PATRONI), str(config)],
            log=log or folder / "log",
            env={"HOME": str(folder)},
        )
        self.postgresql = Postgresql(self._data)
        self.patroni = Patroni(self)

    def _settings(self, etcd: str, identity: Identity | None) -> dict[str, Any]:
        """Patroni's, of which JSON is a form."""
        way, method = ("hostssl", "scram-sha-256") if identity is not None else ("host", "trust")
        parameters: dict[str, object] = {
            "unix_socket_directories": str(self.folder),
            "wal_buffers": "16MB",
            "wal_writer_delay": "10ms",
        }
        verified = {}
        if identity is not None:
            parameters |= {"ssl": True}
            parameters |= {"ssl_cert_file": str(self.folder / CHAIN_FILE)}
            parameters |= {"ssl_key_file": str(self.folder / KEY_FILE)}
            verified = {"sslmode": "verify-full", "sslrootcert": str(self.folder / ROOT_FILE)}
        return {
            "scope": "eskin",
            "name": self.name,
            "restapi": {
                "listen": self._rest,
                "connect_address": self._rest,
            },
            "etcd3": {"hosts": [etcd]},
            "bootstrap": {
                "dcs": DYNAMIC,
                "initdb": [{"encoding": "UTF8"}, {"locale": "C.UTF-8"}, "data-checksums"],
            },
            "postgresql": {
                "listen": f"{self.address}:{self.port}",
                "connect_address": f"{self.address}:{self.port}",
                "use_unix_socket": True,
                "data_dir": str(self._data),
                "bin_dir": str(Path(program("initdb")).resolve().parent),
                "remove_data_directory_on_rewind_failure": True,
                "remove_data_directory_on_diverged_timelines": True,
                "pgpass": str(self.folder / "pgpass"),
                "parameters": parameters,
                "pg_hba": [
                    "local all all trust",
                    f"{way} replication {_REPLICATOR} all {method}",
                    f"{way} all all all {method}",
                ],
                "authentication": {
                    "superuser": {"username": ADMIN, "password": "a", **verified},
                    "replication": {"username": _REPLICATOR, "password": "b", **verified},
                },
            },
        }

    def show(self, identity: Identity) -> None:
        """Give the server what it shows to clients; a running one takes it on SIGHUP."""
        owner = self.folder.stat()
        for name in (CHAIN_FILE, KEY_FILE, ROOT_FILE):
            shutil.copyfile(identity.directory / name, self.folder / name)
            (self.folder / name).chmod(0o600)
            os.chown(self.folder / name, owner.st_uid, owner.st_gid)

    def is_primary(self) -> bool:
        """Whether its server takes writes."""
        return self._says("NOT pg_is_in_recovery()")

    def has_standby(self) -> bool:
        """Whether its commits wait for another member."""
        return self._says("EXISTS (SELECT FROM pg_stat_replication WHERE sync_state = 'sync')")

    def is_synchronous(self) -> bool:
        """Whether Patroni holds it for a synchronous standby, which it may promote."""
        try:
            return httpx.get(f"http://{self._rest}/synchronous", timeout=2, verify=PLAIN).is_success
        except httpx.HTTPError:
            return False

    def execute(self, statement: str) -> Sequence[Sequence[Any]]:
        """Do something as the administrator; gives the rows of an answer.

        Raises:
            psycopg.Error: The server does not answer, or refuses it.
        """
        words = f"host={self.folder} port={self.port} user={ADMIN} dbname=postgres"
        with psycopg.connect(words, autocommit=True, connect_timeout=2) as connection:
            done = connection.execute(statement.encode())
            return done.fetchall() if done.description else []

    def _says(self, condition: str) -> bool:
        try:
            return bool(self.execute(f"SELECT {condition}")[0][0])
        except psycopg.Error:
            return False

    def signal(self, number: signal.Signals) -> None:
        """Send a signal; what stops it, or lets it go on, is for its server, too."""
        super().signal(number)
        if number in {signal.SIGSTOP, signal.SIGCONT}:
            self.postgresql.signal(number)

    def kill(self) -> None:
        """End both as a power cut would."""
        super().kill()
        self.postgresql.kill()


class PatroniCluster:
    """Two members on loopback; all goes with it.

    Attributes:
        members: Both.
        etcd: What they agree by.
    """

    def __init__(self) -> None:
        self._home = Path(tempfile.mkdtemp(prefix="ha-"))
        self._home.chmod(0o711)
        self.etcd = Etcd(self._home)
        self.members = []
        for name in ("one", "two"):
            folder = self._home / name
            folder.mkdir()
            self.members.append(Member(name, folder, self.etcd.clients))
        self._exits = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as exits:
            exits.callback(shutil.rmtree, self._home)
            exits.enter_context(self.etcd)
            for member in self.members:
                member.start()
                exits.callback(_end, member)
            self.settle()
            self._exits = exits.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._exits.close()

    def settle(self) -> Member:
        """Wait until a standby may be promoted; gives the primary.

        Patroni notes it in etcd an instant after the primary's commits begin to wait for it.
        """
        primary = settle(self.members)
        noted = "a standby may be promoted"
        wait_until(lambda: any(member.is_synchronous() for member in self.members), noted)
        return primary

    def standby(self) -> Member:
        """The one that is not the primary, once it may be promoted."""
        primary = self.settle()
        return next(member for member in self.members if member is not primary)

    def create(self, name: str) -> URL:
        """Make an empty database; gives it at both members."""
        self.settle().execute(f"CREATE DATABASE {name}")
        hosts = "&".join(f"host={each.address}:{each.port}" for each in self.members)
        return parse_url(f"postgresql://{ADMIN}@/{name}?{hosts}")


def settle(members: Sequence[Member]) -> Member:
    """Wait until there are a primary, which is given, and a synchronous standby."""
    found: list[Member] = []

    def is_settled() -> bool:
        found[:] = [member for member in members if member.is_primary()]
        return len(found) == 1 and found[0].has_standby()

    wait_until(is_settled, "there are a primary and a synchronous standby")
    return found[0]


def _end(member: Member) -> None:
    """End it in good order if it can, else in any."""
    assert member.process is not None
    if member.process.poll() is None:
        member.terminate()
        with suppress(subprocess.TimeoutExpired):
            member.process.wait(20)
            return
    member.kill()


def _as_another_user(folder: Path) -> list[str]:
    """Words before a command of another user, who may read a Python in root's home."""
    *words, end = as_another_user(folder)
    reads = ["--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search"]
    return [*words, *reads, end]
