"""A PostgreSQL server of the tests' own: an unprivileged user's, on a Unix socket, durable."""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

import psutil
import psycopg
from eskin_cloud.store import Store
from eskin_cloud.store.location import parse_url
from eskin_cloud.store.schema.alarm_tables import alarm_state
from eskin_cloud.store.schema.tables import feed, metadata, versions
from sqlalchemy import delete

from eskin.identity.identity import CHAIN_FILE, KEY_FILE
from tests.support.processes import Running, free_port, wait_until

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import TracebackType

    from sqlalchemy import URL

    from eskin.identity import Identity

ADMIN: Final = "eskin"
"""The user that makes the cluster."""
_TEMPLATE: Final = "pattern"
_SETTINGS: Final = Path(__file__).parents[2] / "services" / "database" / "postgresql.conf"
"""Those of the cluster that is shipped, but for where it is and who may come in."""


def program(name: str, *, programs: Path | None = None) -> str:
    """Path of one of the server's programs; of those in a folder, if one is named."""
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    if programs is not None:
        folders = [programs]
    path = os.pathsep.join([*map(str, folders), os.environ["PATH"]])
    found = shutil.which(name, path=path)
    assert found is not None, f"{name} is missing; install it (apt-get install postgresql)"
    return found


class Server(Running):
    """The server with all its processes: it forks one for each connection, and some for itself."""

    def terminate(self) -> None:
        """End it, whatever clients are connected."""
        self.signal(signal.SIGINT)

    def signal(self, number: signal.Signals) -> None:
        """Send a signal; what stops it, or lets it go on, is for all its processes."""
        super().signal(number)
        if number in {signal.SIGSTOP, signal.SIGCONT}:
            for process in self._children():
                with suppress(psutil.NoSuchProcess):  # it ended, and was reaped just now
                    process.send_signal(number)

    def kill(self) -> None:
        """End all of them as a power cut would, and wait: what is left keeps the next one out."""
        self.signal(signal.SIGSTOP)  # and none is forked meanwhile
        children = self._children()
        for process in children:
            process.kill()
        super().kill()
        wait_until(lambda: all(_is_gone(process) for process in children), "PostgreSQL is gone")

    def _children(self) -> list[psutil.Process]:
        assert self.process is not None
        try:
            return psutil.Process(self.process.pid).children()
        except psutil.NoSuchProcess:
            return []


class Cluster:
    """A running server; its databases go with it.

    Args:
        identity: With which it listens to the network, too, by TLS and for passwords.
        address: Where it does.
        folder: Where it is; a fresh one else.
        prefix: Words before the server's command.
        log: Takes what it says; a file in the folder else.
        programs: Folder of the server's programs; those of the system else.
        sockets: Folder of its socket; that of its data else.
        settings: More settings of the server.

    Attributes:
        folder: Its data and its socket.
        port: On the network; 0 if it does not listen there.
        running: Its processes.
    """

    def __init__(
        self,
        identity: Identity | None = None,
        *,
        address: str = "127.0.0.1",
        folder: Path | None = None,
        prefix: Sequence[str] = (),
        log: Path | None = None,
        programs: Path | None = None,
        sockets: Path | None = None,
        settings: Mapping[str, str] | None = None,
    ) -> None:
        self.port = int((settings or {}).get("port", 0))
        if identity is not None:
            self.port = free_port()
        self.folder = folder or Path(tempfile.mkdtemp(prefix="pg-"))
        self._sockets = sockets or self.folder
        self._numbers = count(1)
        as_user = as_another_user(self.folder) if os.geteuid() == 0 else []
        data = self.folder / "data"
        initdb = program("initdb", programs=programs)
        subprocess.run(
            [*as_user, initdb, "-D", data, "-U", ADMIN, "-A", "trust", "-E", "UTF8",
             "--locale=C.UTF-8", "--no-sync", "--no-instructions"],
            check=True, stdout=subprocess.DEVNULL, cwd=self.folder,
        )  # fmt: skip
        shutil.copyfile(_SETTINGS, self.folder / "postgresql.conf")
        chosen = {
            "config_file": f"{self.folder}/postgresql.conf",
            "hba_file": f"{data}/pg_hba.conf",
            "unix_socket_directories": str(self._sockets),
            **(settings or {}),
        }
        if identity is not None:
            chosen |= {"listen_addresses": address, "port": str(self.port)}
            chosen |= self._encrypt(identity)
        options = [f"-c{name}={value}" for name, value in chosen.items()]
        server = program("postgres", programs=programs)
        words = [*prefix, *as_user, server, "-D", str(data), *options]
        self.running = Server(words, log=log or self.folder / "log")

    def _encrypt(self, identity: Identity) -> dict[str, str]:
        """Let clients in by TLS and with a password only."""
        self.show(identity)
        (self.folder / "data" / "pg_hba.conf").write_text(
            "local all all trust\nhostssl all all all scram-sha-256\n"
        )
        return {"ssl": "on", "ssl_cert_file": CHAIN_FILE, "ssl_key_file": KEY_FILE}

    def show(self, identity: Identity) -> None:
        """Give it what it shows to clients; a running one takes it on SIGHUP."""
        data = self.folder / "data"
        owner = data.stat()
        for name in (CHAIN_FILE, KEY_FILE):
            shutil.copyfile(identity.directory / name, data / name)
            (data / name).chmod(0o600)
            os.chown(data / name, owner.st_uid, owner.st_gid)

    def __enter__(self) -> Self:
        self.start()
        self.prepare()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self.running.process is not None and self.running.process.poll() is None:
            self.stop()
        shutil.rmtree(self.folder)

    def start(self) -> None:
        """Start, and wait until it accepts connections."""
        self.running.start()
        wait_until(self.answers, "PostgreSQL answers")

    def prepare(self) -> None:
        """Make the store that databases are copied from."""
        self.execute(f"CREATE DATABASE {_TEMPLATE}", database="postgres")
        Store(self.place(_TEMPLATE)).close()

    def stop(self) -> None:
        """End it, whatever clients are connected."""
        self.running.stop()

    def shut(self, place: URL) -> None:
        """Reject connections to a database any more."""
        name = place.database
        self.execute(f"ALTER DATABASE {name} ALLOW_CONNECTIONS false", database="postgres")
        # It waits until they are gone.
        end = "SELECT pg_terminate_backend(pid, 60000) FROM pg_stat_activity WHERE datname ="
        self.execute(f"{end} '{name}'", database="postgres")

    def admit(self, place: URL) -> None:
        """Let everybody into a database again."""
        name = place.database
        self.execute(f"ALTER DATABASE {name} ALLOW_CONNECTIONS true", database="postgres")

    def fresh(self, *, empty: bool = False) -> URL:
        """A database of its own: a store's, or one without any table."""
        name = f"store_{next(self._numbers)}"
        pattern = "template1" if empty else _TEMPLATE
        self.execute(f"CREATE DATABASE {name} TEMPLATE {pattern}", database="postgres")
        return self.place(name)

    def clear(self, place: URL) -> None:
        """Make a store as it was: far cheaper than a database for each test."""
        # As a replica, so that what is append only can be emptied.
        words = ["SET session_replication_role = replica"]
        words += [str(delete(table)) for table in metadata.sorted_tables if table not in _KEPT]
        words += ["UPDATE feed SET cursor = slot, compacted = slot, writer = NULL"]
        words += ["UPDATE alarm_state SET holder = NULL, until = 0, version = 0"]
        words += ["UPDATE alarm_state SET last_alarm = 0, last_number = 0"]
        self.execute("; ".join(words), database=str(place.database))

    def execute(self, statements: str, *, database: str) -> None:
        """Do something as the administrator."""
        with psycopg.connect(self.words(database), autocommit=True) as connection:
            connection.execute(statements.encode())

    def answers(self) -> bool:
        """Whether it accepts connections."""
        try:
            psycopg.connect(self.words("postgres")).close()
        except psycopg.OperationalError:
            return False
        return True

    def words(self, database: str) -> str:
        """What libpq connects by as the administrator, by the socket."""
        port = f" port={self.port}" if self.port else ""
        return f"host={self._sockets}{port} user={ADMIN} dbname={database}"

    def place(self, database: str) -> URL:
        """A database, by the socket."""
        port = f":{self.port}" if self.port else ""
        return parse_url(f"postgresql://{ADMIN}@{port}/{database}?host={self._sockets}")


_KEPT: Final = (versions, feed, alarm_state)


def _is_gone(process: psutil.Process) -> bool:
    try:
        gone: bool = process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True
    return gone


def as_another_user(folder: Path) -> list[str]:
    """Words before a command, by which it is no longer root's; the folder is its own, too."""
    names = {entry.pw_name for entry in pwd.getpwall()}
    user = pwd.getpwnam("postgres" if "postgres" in names else "daemon")
    os.chown(folder, user.pw_uid, user.pw_gid)
    ids = [f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups"]
    return ["setpriv", *ids, "--"]
