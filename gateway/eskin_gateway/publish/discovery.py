"""Which channels are announced for discovery, and when they are taken away again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.errors import UntrustedCertificateError
from eskin.privacy import is_biometric
from eskin.wire.messages import Status
from eskin_gateway.publish.homeassistant import config, config_topic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin_gateway.mqtt.transport import Publication
    from eskin_gateway.spool.node_certificates import NodeCertificates
    from eskin_gateway.spool.spool import Spool

_AT_ONCE: Final = 64
"""Nodes that are judged in one idle moment."""


class Discovery:
    """Announces the public channels of each node, until the node goes.

    A node goes when its certificate is no more good (revoked or expired), or when it has not told
    how it fares for ``forget_ns``. It comes back with its next status. Only for one thread.

    Args:
        prefix: Topic under which Home Assistant looks.
        forget_ns: Age in ns of its latest status at which a node is gone.
        spool: Remembers nodes over restarts.
        node_certificates: Judges certificates.
        now: UTC ns.
    """

    def __init__(
        self,
        prefix: str,
        *,
        forget_ns: int,
        spool: Spool,
        node_certificates: NodeCertificates,
        now: Callable[[], int],
    ) -> None:
        self._prefix = prefix
        self._forget_ns = forget_ns
        self._spool = spool
        self._node_certificates = node_certificates
        self._now = now
        self._told: dict[str, Status] = {}
        self._due: list[str] = []
        self._again: set[str] = set()
        self._restore()

    def heard(self, name: str, status: Status) -> Iterator[Publication]:
        """A node told how it fares; gives what there is to publish."""
        if self._is_old(status):
            return
        before = self._told.get(name)
        self._told[name] = status
        if before is not None and _identity(before) == _identity(status):
            return
        now_there = {channel.channel for channel in status.channels}
        for channel in () if before is None else before.channels:
            if channel.channel not in now_there:
                yield self._removal(name, channel.channel)
        yield from self._announce(name, status)

    def renew(self) -> None:
        """The broker is back, and may have forgotten what it kept: all of it comes again."""
        self._due = list(self._told)
        self._again = set(self._told)

    def idle(self) -> Iterator[Publication]:
        """Gives what there is to publish; looks at some nodes each time."""
        self._node_certificates.refresh()
        self._due = self._due or list(self._told)
        due, self._due = self._due[:_AT_ONCE], self._due[_AT_ONCE:]
        for name in due:
            status = self._told[name]
            if self._is_old(status) or not self._is_trusted(name):
                del self._told[name]
                for channel in status.channels:
                    yield self._removal(name, channel.channel)
            elif name in self._again:
                yield from self._announce(name, status)
            self._again.discard(name)

    def _restore(self) -> None:
        for name in self._spool.nodes():
            record = self._spool.node(name)
            if record is not None and record.status is not None:
                self._told[name] = Status.decode(record.status)

    def _announce(self, name: str, status: Status) -> Iterator[Publication]:
        for channel in status.channels:
            if not is_biometric(channel.channel):
                topic = config_topic(self._prefix, name, channel.channel)
                yield topic, config(name, status, channel), True

    def _removal(self, name: str, channel: str) -> Publication:
        return config_topic(self._prefix, name, channel), b"", True

    def _is_old(self, status: Status) -> bool:
        return status.time[1] < self._now() - self._forget_ns

    def _is_trusted(self, name: str) -> bool:
        record = self._spool.node(name)
        if record is None or record.thumbprint is None:
            return False
        try:
            return self._node_certificates.find(record.thumbprint) is not None
        except UntrustedCertificateError:
            return False


def _identity(status: Status) -> tuple[object, ...]:
    """What an announcement depends on."""
    return status.profile, status.description, status.channels
