"""Health and metrics of the gateway."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from eskin.errors import SpoolError

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.identity import RevocationFile
    from eskin_gateway.commands.poller import CommandPoller
    from eskin_gateway.forward.forwarder import Forwarder
    from eskin_gateway.ingest.commit_loop import CommitLoop
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.mqtt.mqtt_transport import MqttTransport
    from eskin_gateway.mqtt.receive_queue import ReceiveQueue
    from eskin_gateway.ops.subject_sync import SubjectSync
    from eskin_gateway.publish.presence import Presence
    from eskin_gateway.spool.spool import Spool


@dataclass(kw_only=True, slots=True)
class Health:
    """Collects the state of all parts."""

    broker: MqttTransport
    receive_queue: ReceiveQueue
    commit_loop: CommitLoop
    spool: Spool
    forwarder: Forwarder
    command_poller: CommandPoller
    presence: Presence
    revocations: RevocationFile
    subject_sync: SubjectSync
    _spool_fault: str | None = field(default=None, init=False)

    def reasons(self) -> list[str]:
        """Why the gateway is not healthy; empty if it is."""
        faults = {
            "broker": self.broker.fault,
            "spool": self.commit_loop.fault or self._spool_fault,
            "cloud": self.forwarder.fault,
            "commands": self.command_poller.fault,
            "revocations": self.revocations.fault,
            "subjects": self.subject_sync.fault,
        }
        return [f"{part}: {fault}" for part, fault in faults.items() if fault is not None]

    def report(self) -> dict[str, Any]:
        """The document of ``/healthz``."""
        spool, receive_queue = self.spool.statistics, self.receive_queue.statistics
        oldest_age = self.oldest_age()
        reasons = self.reasons()
        return {
            "status": "degraded" if reasons else "ok",
            "reasons": reasons,
            "broker": {"connected": self.broker.connected},
            "cloud": {"reachable": self.forwarder.reachable},
            "receive_queue": {
                "messages": receive_queue.depth,
                "capacity": receive_queue.capacity,
                "peak": receive_queue.peak,
                "dropped": receive_queue.dropped,
                "bytes": receive_queue.used,
            },
            "spool": {
                "messages": spool.messages,
                "bytes": spool.used,
                "capacity_bytes": spool.capacity,
                "oldest_age_s": oldest_age,
                "retrying": self.forwarder.retrying,
                "dead_letters": spool.dead_letters,
                "dead_letters_dropped": spool.dead_letters_dropped,
            },
            "nodes": {"online": self.presence.online},
        }

    def oldest_age(self) -> float | None:
        """Seconds since the oldest message in the spool was received; ``None`` if it is empty.

        NaN if the spool cannot be read, so that the other metrics are still exported.
        """
        try:
            oldest = self.spool.oldest()
        except SpoolError as error:
            self._spool_fault = str(error)
            return math.nan
        self._spool_fault = None
        return None if oldest is None else max(0.0, (time.time_ns() - oldest) / 1e9)

    def export(self, metrics: Metrics) -> None:
        """Add the state of the parts to the metrics."""
        spool, receive_queue, forwarder = self.spool, self.receive_queue, self.forwarder
        gauges: dict[str, tuple[str, Callable[[], float]]] = {
            "spool_messages": ("messages in the spool", lambda: spool.statistics.messages),
            "spool_bytes": ("bytes of messages in the spool", lambda: spool.statistics.used),
            "spool_capacity_bytes": ("its capacity", lambda: spool.statistics.capacity),
            "spool_oldest_seconds": ("age of its oldest", lambda: self.oldest_age() or 0.0),
            "dead_letters": ("stored dead letters", lambda: spool.statistics.dead_letters),
            "dead_letters_dropped": (
                "dead letters dropped for newer ones",
                lambda: spool.statistics.dead_letters_dropped,
            ),
            "spool_retrying": (
                "messages in the spool at which the cloud fails",
                lambda: forwarder.retrying,
            ),
            "receive_queue_messages": (
                "messages in the receive queue",
                lambda: receive_queue.statistics.depth,
            ),
            "receive_queue_bytes": ("their bytes", lambda: receive_queue.statistics.used),
            "receive_queue_peak": (
                "most messages in it so far",
                lambda: receive_queue.statistics.peak,
            ),
            "receive_queue_dropped": (
                "messages dropped because it was full",
                lambda: receive_queue.statistics.dropped,
            ),
            "publications_dropped": (
                "publications dropped while disconnected or congested",
                lambda: self.broker.dropped,
            ),
            "broker_connected": ("1 while connected", lambda: self.broker.connected),
            "cloud_reachable": ("1 while the cloud answers", lambda: forwarder.reachable is True),
            "confirmed_missing": (
                "messages that the cloud confirmed and no longer has",
                lambda: forwarder.missing,
            ),
            "erasures_pending": (
                "erasures that the cloud has not confirmed",
                lambda: self.subject_sync.pending,
            ),
            "nodes_online": ("nodes online", lambda: self.presence.online),
            "healthy": ("1 while the gateway is healthy", lambda: not self.reasons()),
        }
        for name, (text, read) in gauges.items():
            metrics.gauge(name, text, read)
