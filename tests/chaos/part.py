"""A part of the site: one process, and all that can go wrong around it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Final

from eskin.identity import Identity, install, next_key
from tests.processes import Running

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from eskin.identity import Authority
    from tests.chaos.clocks import Wallclock
    from tests.chaos.disks import Disk
    from tests.chaos.hosts import Host

INSIDER: Final = 8886
"""Port on the broker's loopback, where the broker itself speaks without being asked who it is."""


class Part:
    """One process with its host, its clock, its disk and its identities.

    Args:
        name: Its name.
        argv: Its program.
        host: Where it runs.
        disk: What it stores on.
        clock: What it takes for the time.
        identities: Folders of its identities.
        authority: Renews them.
        attacker: Words before a command that shall run beside the broker.
        log: Takes what it says.
    """

    def __init__(
        self,
        name: str,
        argv: Sequence[str],
        *,
        host: Host,
        disk: Disk,
        clock: Wallclock,
        identities: Sequence[Path],
        authority: Authority,
        attacker: Sequence[str],
        log: Path,
    ) -> None:
        self.name = name
        self.host = host
        self.disk = disk
        self.clock = clock
        self.identities = identities
        self.running = Running([*host.prefix, *argv], log=log, env=clock.environment)
        self._authority = authority
        beside = log.with_name(f"{name}-attacker.log")
        words = [*attacker, sys.executable, "-m", "tests.chaos.attacker", str(INSIDER)]
        self.parrot = Running([*words, "repeat"], log=beside)
        self._flood = Running([*words, "flood"], log=beside)

    def renew(self, directory: Path) -> None:
        """Give an identity its next certificate and key, as the CA service does."""
        own = Identity.load(directory)
        key = next_key(directory).public_key()
        hosts = (self.host.address,)
        install(directory, self._authority.issue(own.kind, own.name, key, hosts=hosts))

    def flood(self) -> None:
        """Let rubbish rain, until it is all out."""
        self.calm()
        self._flood.start()

    def calm(self) -> None:
        """End what is left of it."""
        for attacker in (self._flood, self.parrot):
            if attacker.process is not None and attacker.process.poll() is None:
                attacker.kill()
