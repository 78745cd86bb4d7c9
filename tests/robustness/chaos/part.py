"""A part of the site: one process, and all that can go wrong around it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Final, TypedDict, Unpack

from eskin.identity import Identity, install, next_key
from tests.support.processes import Running

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from eskin.identity import CertificateAuthority
    from tests.robustness.chaos.clocks import Wallclock
    from tests.robustness.chaos.disks import Disk
    from tests.robustness.chaos.hosts import Host

INSIDER: Final = 8886
"""Port on the broker's loopback, where the broker itself speaks without being asked who it is."""


class Around(TypedDict):
    """What is alike around all parts.

    Attributes:
        authority: Renews their identities.
        attacker: Words before a command that shall run beside the broker.
        beside: Takes what such a command says.
    """

    authority: CertificateAuthority
    attacker: Sequence[str]
    beside: Path


class Part:
    """One process with its host, its clock, its disk and its identities.

    Args:
        name: Its name.
        running: Its process.
        host: Where it runs.
        disk: What it stores on.
        clock: What it takes for the time; ``None``: nothing rests on it.
        identities: Folders of its identities.
        around: What is alike for all.
    """

    def __init__(
        self,
        name: str,
        running: Running,
        *,
        host: Host,
        disk: Disk,
        clock: Wallclock | None,
        identities: Sequence[Path],
        **around: Unpack[Around],
    ) -> None:
        self.name = name
        self.running = running
        self.host = host
        self.disk = disk
        self.clock = clock
        self.identities = identities
        self._authority = around["authority"]
        words = [
            *around["attacker"],
            sys.executable,
            "-m",
            "tests.robustness.chaos.attacker",
            str(INSIDER),
        ]
        self.parrot = Running([*words, "repeat"], log=around["beside"])
        self._flood = Running([*words, "flood"], log=around["beside"])

    def start(self) -> None:
        """Start it for the first time."""
        self.running.start()

    def processes(self, only: str) -> Running:
        """Its process; one of several by its name, where it has several."""
        assert not only, f"{self.name} has no {only}"
        return self.running

    def renew(self, directory: Path) -> None:
        """Give an identity its next certificate and key, as the CA service does."""
        own = Identity.load(directory)
        key = next_key(directory).public_key()
        hosts, site = (self.host.address,), own.site if own.kind.has_site else ""
        install(directory, self._authority.issue(own.kind, own.name, key, site=site, hosts=hosts))

    def take_shard(self) -> None:
        """Have a shard moved to it: only workers can."""
        raise AssertionError(f"{self.name} keeps no shards")

    def come_back(self) -> None:
        """Be well again after its disk was full: others need no help for that."""

    def flood(self) -> None:
        """Let rubbish rain, until it is all out."""
        self.calm()
        self._flood.start()

    def close(self) -> None:
        """Take its disk away."""
        self.disk.unmount()

    def calm(self) -> None:
        """End what is left of it."""
        for attacker in (self._flood, self.parrot):
            if attacker.process is not None and attacker.process.poll() is None:
                attacker.kill()
