"""The database as a part: PostgreSQL on a host and a disk of its own, or a cluster of them."""

from __future__ import annotations

import secrets
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final, Unpack

from eskin_cloud.store.location import parse_url

from eskin.identity import Identity
from eskin.identity.identity import ROOT_FILE
from tests.robustness.chaos.disks import Disk
from tests.robustness.chaos.faults import DATABASE
from tests.robustness.chaos.part import Around, Part
from tests.support import patroni
from tests.support.postgresql import Cluster
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tests.robustness.chaos.hosts import Host
    from tests.support.processes import Running

_SKIN: Final = "skin"
_CLOUD: Final = "cloud"
_DISK: Final = 2048 << 20


class Server(Part):
    """A PostgreSQL server on a disk of its own.

    Args:
        name: Its name.
        host: Where it runs.
        folder: Takes its log.
        identity: With which it listens to the network, too.
        programs: Folder of the server's programs; those of the system else.
        sockets: Folder of its socket; that of its data else.
        settings: More settings of the server.
        around: As of any part.

    Attributes:
        cluster: The server.
    """

    def __init__(
        self,
        name: str,
        *,
        host: Host,
        folder: Path,
        identity: Identity | None = None,
        programs: Path | None = None,
        sockets: Path | None = None,
        settings: Mapping[str, str] | None = None,
        **around: Unpack[Around],
    ) -> None:
        # Its user may look into no folder of root's, and a socket's path is short.
        self._home = tempfile.TemporaryDirectory(prefix="pg-")
        home = Path(self._home.name)
        disk = Disk(home, _DISK)
        self.cluster = Cluster(
            identity,
            address=host.address,
            folder=home,
            prefix=host.prefix,
            log=folder / f"{name}.log",
            programs=programs,
            sockets=sockets,
            settings=settings,
        )
        super().__init__(
            name,
            self.cluster.running,
            host=host,
            disk=disk,
            clock=None,
            identities=[] if identity is None else [identity.directory],
            **around,
        )

    def close(self) -> None:
        """Take its disk away, and where it was."""
        super().close()
        self._home.cleanup()

    def renew(self, directory: Path) -> None:
        """Give it its next certificate and key, where it finds them."""
        super().renew(directory)
        self.cluster.show(Identity.load(directory))

    def come_back(self) -> None:
        """Wait until it accepts connections: without room for its log it ends, and starts anew."""

        def answers() -> bool:
            process = self.running.process
            if process is None or process.poll() is not None:
                self.running.start()
            return self.cluster.answers()

        wait_until(answers, "PostgreSQL answers after its disk was full")


class Database(Server):
    """The cloud comes to it by TLS and with a password, over a cable; the judge by a Unix socket.

    Args:
        identity: The server's.
        host: Where it runs.
        folder: Takes its log, and what the cloud needs to come to it.
        around: As of any part.

    Attributes:
        place: The store, as the judge comes to it, whatever befalls the cable.
        settings: The section ``store`` of the cloud's settings.
    """

    def __init__(
        self, identity: Identity, *, host: Host, folder: Path, **around: Unpack[Around]
    ) -> None:
        super().__init__(DATABASE, host=host, folder=folder, identity=identity, **around)
        self.place = self.cluster.place(_SKIN)
        self._password = folder / "database.password"
        self.settings: dict[str, object] = {
            "url": f"postgresql://{_CLOUD}@{host.address}:{self.cluster.port}/{_SKIN}",
            "password_file": self._password,
            "root": identity.directory / ROOT_FILE,
        }

    @property
    def parts(self) -> Sequence[Part]:
        """Its parts."""
        return [self]

    def start(self) -> None:
        """Start it for the first time, and make an empty database for the cloud."""
        self.cluster.start()
        for words in _make_database(self._password):
            self.cluster.execute(words, database="postgres")


class Member(Part):
    """A member of a cluster: Patroni and its PostgreSQL, on a host and a disk of their own.

    Args:
        identity: Its server's.
        host: Where it runs.
        etcd: Where etcd is.
        folder: Takes the log of Patroni.
        around: As of any part.

    Attributes:
        running: Both of its processes.
    """

    running: patroni.Member

    def __init__(
        self, identity: Identity, *, host: Host, etcd: str, folder: Path, **around: Unpack[Around]
    ) -> None:
        self._home = tempfile.TemporaryDirectory(prefix="pg-")
        home = Path(self._home.name)
        disk = Disk(home, _DISK)
        running = patroni.Member(
            host.name,
            home,
            etcd,
            address=host.address,
            identity=identity,
            prefix=host.prefix,
            log=folder / f"{host.name}.log",
        )
        super().__init__(
            host.name,
            running,
            host=host,
            disk=disk,
            clock=None,
            identities=[identity.directory],
            **around,
        )
        self.running = running

    def close(self) -> None:
        """Take its disk away, and where it was."""
        super().close()
        self._home.cleanup()

    def processes(self, only: str) -> Running:
        """Both, or one of them."""
        alone: dict[str, Running] = {"": self.running}
        alone |= {"postgresql": self.running.postgresql, "patroni": self.running.patroni}
        return alone[only]

    def renew(self, directory: Path) -> None:
        """Give its server its next certificate and key, where it finds them."""
        super().renew(directory)
        self.running.show(Identity.load(directory))


class DatabaseCluster:
    """All members, and etcd, on which nothing befalls.

    Args:
        identities: The members' servers'.
        hosts: Where they run.
        etcd: Where etcd runs.
        folder: Takes logs, and what the clouds need to come to it.
        around: As of any part.

    Attributes:
        members: Its parts.
        etcd: Its etcd.
        place: The store, as the judge comes to it.
        settings: The section ``store`` of the clouds' settings.
    """

    def __init__(
        self,
        identities: Sequence[Identity],
        hosts: Sequence[Host],
        etcd: Host,
        *,
        folder: Path,
        **around: Unpack[Around],
    ) -> None:
        self.etcd = patroni.Etcd(folder, address=etcd.address, prefix=etcd.prefix)
        self.members = [
            Member(own, host=host, etcd=self.etcd.clients, folder=folder, **around)
            for own, host in zip(identities, hosts, strict=True)
        ]
        servers = [member.running for member in self.members]
        sockets = "&".join(f"host={each.folder}:{each.port}" for each in servers)
        self.place = parse_url(f"postgresql://{patroni.ADMIN}@/{_SKIN}?{sockets}")
        addresses = "&".join(f"host={each.address}:{each.port}" for each in servers)
        self._password = folder / "database.password"
        self.settings: dict[str, object] = {
            "url": f"postgresql://{_CLOUD}@/{_SKIN}?{addresses}",
            "password_file": self._password,
            "root": identities[0].directory / ROOT_FILE,
        }

    @property
    def parts(self) -> Sequence[Part]:
        """Its parts."""
        return self.members

    def start(self) -> None:
        """Start the members for the first time, and make an empty database for the clouds."""
        self.etcd.begin()
        servers = [member.running for member in self.members]
        for number, server in enumerate(servers):
            server.start()
            if number == 0:
                server.wait_for(server.is_primary, "the first is primary")
        primary = patroni.settle(servers)
        for words in _make_database(self._password):
            primary.execute(words)


def _make_database(password: Path) -> Sequence[str]:
    """Statements that make the clouds' user, with a fresh password, and their database."""
    password.write_text(secrets.token_hex())
    role = f"CREATE ROLE {_CLOUD} LOGIN PASSWORD '{password.read_text()}'"
    return role, f"CREATE DATABASE {_SKIN} OWNER {_CLOUD}"
