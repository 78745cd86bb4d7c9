"""The guard of a Mosquitto broker: what the CA says holds there, too, within seconds.

It brings renewed certificates, anchors and revocation lists, which Mosquitto 2.0 reads anew on
SIGHUP; it refuses the revoked from then on. Connections that are open it leaves alone: its
dynamic-security plugin ends those of a user name. It is loaded on a listener of its own, a socket
file that only this user can reach, so that it has no say in the other listeners' access lists.
"""

from __future__ import annotations

import json
import logging
import signal
import subprocess
import time
from functools import partial
from threading import Event
from typing import TYPE_CHECKING, Final

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from eskin.errors import IdentityError
from eskin.identity import ChainVerifier, IdentityKind
from eskin.identity.identity import ROOT_FILE, write_whole
from eskin.mosquitto import revoked, versions
from eskin.mosquitto.configuration import KINDS
from eskin.runtime.stop_signals import stop_on_signals
from eskin.runtime.supervised import FaultLog
from eskin_ca.client import fetch_anchor, fetch_revocations, fetch_revoked
from eskin_ca.http_client import NotReadyError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from eskin.runtime.files.stamp import Version

log = logging.getLogger(__name__)

CONTROL: Final = "$CONTROL/dynamic-security/v1"
_LOOK_S: Final = 0.5
_ROLE: Final = "guard"
DYNAMIC_SECURITY: Final = {
    "defaultACLAccess": {
        "publishClientSend": False,
        "publishClientReceive": False,
        "subscribe": False,
        "unsubscribe": False,
    },
    "anonymousGroup": _ROLE,
    "groups": [{"groupname": _ROLE, "roles": [{"rolename": _ROLE, "priority": 0}]}],
    "roles": [
        {
            "rolename": _ROLE,
            "acls": [{"acltype": "publishClientSend", "topic": CONTROL, "allow": True}],
        }
    ],
    "clients": [],
}
"""A client of the socket file may use the plugin, and nothing else."""
_PATIENCE_S: Final = 5.0


class MosquittoAgent:
    """Runs a broker and looks after it twice a second.

    Args:
        argv: The broker.
        identity: Folder of its identity, which a `Keeper` renews.
        url: The CA service.
        folder: Takes ``KIND.anchor.pem``, ``KIND.crl.pem`` and ``dynamic-security.json``; in it
            the broker listens on ``control.sock``.
    """

    def __init__(self, argv: Sequence[str], *, identity: Path, url: str, folder: Path) -> None:
        self._argv = list(argv)
        self._identity = identity
        self._url = url
        self._folder = folder
        self._trust = ChainVerifier.following(identity / ROOT_FILE)
        self._revoked: set[tuple[str, str]] = set()
        self.fault_log = FaultLog()
        self._seen: tuple[Version, ...] = ()
        self._stopping = Event()

    def run(self, *, patience: float = 60.0) -> int:
        """Run until the broker ends or a signal comes; gives the broker's exit status.

        Raises:
            IdentityError: The CA service is not there after so many seconds.
        """
        self._first(time.monotonic() + patience)
        settings = self._folder / "dynamic-security.json"
        write_whole(settings, json.dumps(DYNAMIC_SECURITY).encode(), mode=0o600)
        broker = subprocess.Popen(self._argv)  # noqa: S603 - what the operator asks for
        stop_on_signals(self._stopping)
        try:
            self._seen = self._state()
            while broker.poll() is None and not self._stopping.wait(_LOOK_S):
                self._look(broker)
        finally:  # an unguarded broker would accept revoked clients
            broker.terminate()
            status = broker.wait()
        return status

    def _look(self, broker: subprocess.Popen[bytes]) -> None:
        """Bring what the CA says now, and end connections that it would not let in any more."""
        self.fault_log.attempt("fetching lists", self._fetch)
        self.fault_log.attempt("telling the broker", partial(self._tell, broker))
        self.fault_log.attempt("ending connections", self._end_revoked)

    def _tell(self, broker: subprocess.Popen[bytes]) -> None:
        """Have the broker read its files anew, where one is another one."""
        state = self._state()
        if state != self._seen:
            broker.send_signal(signal.SIGHUP)
        self._seen = state

    def _first(self, deadline: float) -> None:
        while True:
            try:
                self._fetch()
            except NotReadyError as error:
                if time.monotonic() > deadline:
                    raise IdentityError(f"the broker is not started: {error}") from error
                self._stopping.wait(_LOOK_S)
            else:
                self._revoked = self._listed()
                return

    def _fetch(self) -> None:
        """Fetch what the CA says of each kind; what fails of one hinders no other."""
        faults: list[IdentityError | OSError] = []
        for kind in KINDS:
            try:
                self._fetch_of(kind)
            except (IdentityError, OSError) as error:
                faults.append(error)
        if faults:
            raise faults[0]

    def _fetch_of(self, kind: IdentityKind) -> None:
        fetch_anchor(self._url, self._identity, kind, self._folder / f"{kind}.anchor.pem")
        file = self._folder / f"{kind}.crl.pem"
        fetch_revocations(self._url, self._identity, kind, file)
        self._trust.revocations(kind, file.read_bytes())

    def _listed(self) -> set[tuple[str, str]]:
        """Certificates that the broker refuses by its lists; others could reconnect at once."""
        refused = revoked(self._folder)
        listed = {one for kind in KINDS for one in fetch_revoked(self._url, self._identity, kind)}
        return {(name, serial) for name, serial in listed if serial in refused}

    def _end_revoked(self) -> None:
        """End connections of clients that were revoked since the last time."""
        listed = self._listed()
        names = sorted({name for name, _ in listed - self._revoked})
        if names:
            end_connections(self._folder / "control.sock", names)
            log.info("connections ended: names=%s", ", ".join(names))
        self._revoked = listed

    def _state(self) -> tuple[Version, ...]:
        return versions(identity=self._identity, anchors=self._folder)


def end_connections(control: Path, names: Sequence[str]) -> None:
    """Have the plugin end all connections of some user names: it does, where it deletes a user.

    Raises:
        IdentityError: The broker does not answer.
    """
    commands = [
        {"command": command, "username": name}
        for name in names
        for command in ("createClient", "deleteClient")
    ]
    client = paho.Client(CallbackAPIVersion.VERSION2, transport="unix")
    try:
        client.connect(str(control), keepalive=10)
        client.loop_start()
        published = client.publish(CONTROL, json.dumps({"commands": commands}), qos=1)
        published.wait_for_publish(_PATIENCE_S)
        if not published.is_published():
            raise IdentityError(f"{control}: the broker's plugin does not answer")
    except (OSError, RuntimeError) as error:
        raise IdentityError(f"{control}: the broker cannot be reached: {error}") from error
    finally:
        client.disconnect()
        client.loop_stop()
