"""Mosquitto as the demo's broker: kept up to date with the CA's folder."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from eskin.demo.settings_files import broker_identity, write_mosquitto
from eskin.demo.supervised_process import SupervisedProcess
from eskin.mosquitto import revoked, versions

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.demo.layout import DemoFolder
    from eskin.demo.settings_files import Ports
    from eskin.runtime.files.stamp import Version

log = logging.getLogger(__name__)


class Mosquitto(SupervisedProcess):
    """The broker's process, which has the CA's folder for its anchors and revocation lists.

    On SIGHUP it reads them and its own certificate anew, yet leaves open connections alone. So a
    revocation restarts it: it refuses the revoked party, and all others connect again.

    Args:
        program: Of Mosquitto 2.
        layout: The demo's folder.
        ports: Where it listens.
    """

    def __init__(self, program: Path, *, layout: DemoFolder, ports: Ports) -> None:
        argv = [str(program), "-c", str(write_mosquitto(layout, ports))]
        super().__init__("broker", argv, log_file=layout.logs / "broker.log")
        self._identity = broker_identity(layout)
        self._authority = layout.authority
        self._seen: tuple[Version, ...] = ()
        self._revoked: set[str] = set()

    def start(self) -> None:
        """Start it.

        Raises:
            ChildError: The program cannot be run.
            OSError: A certificate or a revocation list cannot be read.
        """
        self._seen, self._revoked = self._versions(), revoked(self._authority)
        super().start()

    def keep_alive(self) -> None:
        """Start it again if it died; bring it what was renewed or revoked."""
        try:
            super().keep_alive()
            if self.pid is not None:
                self._follow()
        except (OSError, ValueError) as error:
            log.warning("broker's files not taken over: %s", error)

    def _follow(self) -> None:
        before, self._seen = self._seen, self._versions()
        if self._seen == before:
            return
        if revoked(self._authority) <= self._revoked:
            self.reload()
        else:
            log.info("restarted, as a certificate was revoked: process=%s", self.name)
            self.restart()

    def _versions(self) -> tuple[Version, ...]:
        return versions(identity=self._identity, anchors=self._authority)
