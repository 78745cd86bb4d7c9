"""The database as a part: PostgreSQL on a host and a disk of its own."""

from __future__ import annotations

import secrets
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final, Unpack

from eskin.identity import Identity
from eskin.identity.identity import ROOT_FILE
from tests.robustness.chaos.disks import Disk
from tests.robustness.chaos.faults import DATABASE
from tests.robustness.chaos.part import Around, Part
from tests.support.postgresql import Cluster
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from tests.robustness.chaos.hosts import Host

_SKIN: Final = "skin"
_CLOUD: Final = "cloud"
_DISK: Final = 2048 << 20


class Database(Part):
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
        # Its user may look into no folder of root's, and a socket's path is short.
        self._home = tempfile.TemporaryDirectory(prefix="pg-")
        home = Path(self._home.name)
        disk = Disk(home, _DISK)
        self._cluster = Cluster(
            identity,
            address=host.address,
            folder=home,
            prefix=host.prefix,
            log=folder / f"{DATABASE}.log",
        )
        super().__init__(
            DATABASE,
            self._cluster.running,
            host=host,
            disk=disk,
            clock=None,
            identities=[identity.directory],
            **around,
        )
        self.place = self._cluster.place(_SKIN)
        self._password = folder / "database.password"
        self.settings: dict[str, object] = {
            "url": f"postgresql://{_CLOUD}@{host.address}:{self._cluster.port}/{_SKIN}",
            "password_file": self._password,
            "root": identity.directory / ROOT_FILE,
        }

    def start(self) -> None:
        """Start it for the first time, and make an empty database for the cloud."""
        self._cluster.start()
        self._password.write_text(secrets.token_hex())
        role = f"CREATE ROLE {_CLOUD} LOGIN PASSWORD '{self._password.read_text()}'"
        for words in (role, f"CREATE DATABASE {_SKIN} OWNER {_CLOUD}"):
            self._cluster.execute(words, database="postgres")

    def close(self) -> None:
        """Take its disk away, and where it was."""
        super().close()
        self._home.cleanup()

    def renew(self, directory: Path) -> None:
        """Give it its next certificate and key, where it finds them."""
        super().renew(directory)
        self._cluster.show(Identity.load(directory))

    def come_back(self) -> None:
        """Wait until it accepts connections: without room for its log it ends, and starts anew."""

        def answers() -> bool:
            process = self.running.process
            if process is None or process.poll() is not None:
                self.running.start()
            return self._cluster.answers()

        wait_until(answers, "PostgreSQL answers after its disk was full")
