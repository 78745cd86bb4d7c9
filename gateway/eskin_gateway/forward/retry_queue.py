"""Messages and nodes that the cloud does not take, while it takes others."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from eskin_gateway.spool.batch import SpoolMessage
    from eskin_gateway.upstream.certificates_client import CertificatesClient

log = logging.getLogger(__name__)

_MAX_MESSAGES: Final = 16
"""If more messages fail, one after another, the cloud fails and not the messages."""
_MAX_DELAY_S: Final = 60.0
_MAX_DOUBLINGS: Final = 6
"""Bounds the exponent of the delay."""
_NODE_DELAY_S: Final = 60.0


@dataclass(slots=True)
class _Retry:
    """A message that is retried by itself.

    Attributes:
        message: As it is in the spool.
        failures: How often it failed although the cloud took others.
        due: When it is retried, in the clock's seconds; ``None`` until the cloud takes another one.
    """

    message: SpoolMessage
    failures: int = 0
    due: float | None = None


class RetryQueue:
    """Messages at which the cloud fails, each by itself.

    A single failure does not show that the message causes it: the cloud may fail at all messages.
    So a failed message is only left out until the cloud takes another one. From then on it is
    retried with growing delays. It stays in the spool; after a restart it fails again.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._retries: dict[int, _Retry] = {}

    @property
    def ids(self) -> tuple[int, ...]:
        """Rows of the messages."""
        return tuple(self._retries)

    def __len__(self) -> int:
        return len(self._retries)

    @property
    def fault(self) -> str | None:
        """What fails, or ``None`` if the queue is empty."""
        if not self._retries:
            return None
        message = next(iter(self._retries.values())).message
        return (
            f"the cloud fails at {len(self)} message(s), one of {message.node}, while it takes "
            "others: they stay in the spool and are retried; see the cloud's log"
        )

    def due(self) -> SpoolMessage | None:
        """A message to retry now, by itself."""
        now = self._clock()
        for retry in self._retries.values():
            if retry.due is not None and retry.due <= now:
                return retry.message
        return None

    def add(self, message: SpoolMessage) -> bool:
        """Add a message that failed by itself; return whether others may be sent without it."""
        if message.id in self._retries:
            self.delay(message)
        elif len(self) >= _MAX_MESSAGES:
            return False
        else:
            self._retries[message.id] = _Retry(message)
        return True

    def delay(self, message: SpoolMessage) -> None:
        """Double the delay of a message that failed again, and move it to the end."""
        retry = self._retries.get(message.id)
        if retry is None or retry.due is None:
            return
        self._retries[message.id] = self._retries.pop(message.id)
        retry.failures = min(retry.failures + 1, _MAX_DOUBLINGS)
        retry.due = self._clock() + min(2.0**retry.failures, _MAX_DELAY_S)

    def remove(self, message: SpoolMessage) -> None:
        """Remove a message that has left the spool."""
        self._retries.pop(message.id, None)

    def release_unconfirmed(self) -> bool:
        """Remove messages without a delay; return whether there were any."""
        unconfirmed = [row for row, retry in self._retries.items() if retry.due is None]
        for row in unconfirmed:
            del self._retries[row]
        return bool(unconfirmed)

    def succeeded(self, messages: Sequence[SpoolMessage]) -> None:
        """Note that the cloud took messages: those that failed are retried now."""
        for message in messages:
            self.remove(message)
        for retry in self._retries.values():
            if retry.due is None:
                log.warning("cloud fails at a message: node=%s", retry.message.node)
                retry.due = self._clock()


class UnknownNodes:
    """Registers nodes at the cloud, and leaves out those whose certificate it rejects.

    Their messages stay in the spool and are retried each minute.

    Args:
        certificates_client: Registers certificates.
        clock: Monotonic seconds.
    """

    def __init__(
        self, certificates_client: CertificatesClient, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._certificates_client = certificates_client
        self._clock = clock
        self._registered: set[str] = set()
        self._rejected: dict[str, tuple[float, str]] = {}

    def rejected(self) -> list[str]:
        """Nodes whose messages are left out now."""
        now = self._clock()
        for node in [node for node, (due, _) in self._rejected.items() if due <= now]:
            del self._rejected[node]
        return list(self._rejected)

    def register(self, nodes: Collection[str]) -> None:
        """Register the certificates of nodes that the cloud does not know.

        Raises:
            CloudError: The request failed.
            SpoolError: The spool cannot be read.
        """
        rejected = dict.fromkeys(self._registered.intersection(nodes), "it is unknown still")
        rejected |= self._certificates_client.register(set(nodes) - self._registered)
        due = self._clock() + _NODE_DELAY_S
        for node, reason in rejected.items():
            self._rejected[node] = due, reason
            log.warning("cloud rejects a certificate: node=%s reason=%s", node, reason)
        self._registered -= rejected.keys()
        self._registered |= set(nodes) - rejected.keys()

    def known(self, nodes: Collection[str]) -> None:
        """Note that the cloud took messages of these nodes."""
        self._registered -= set(nodes)

    @property
    def fault(self) -> str | None:
        """What is rejected, or ``None``."""
        if not self._rejected:
            return None
        node, (_, reason) = next(iter(self._rejected.items()))
        return (
            f"the cloud rejects {len(self._rejected)} node(s), one of them {node}: {reason}; their "
            "messages stay in the spool"
        )
