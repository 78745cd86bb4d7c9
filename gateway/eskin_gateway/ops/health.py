"""How the gateway fares, for people and for supervisors."""

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
    """Asks all parts; holds nothing itself."""

    broker: MqttTransport
    receive_queue: ReceiveQueue
    worker: CommitLoop
    spool: Spool
    forwarder: Forwarder
    command_poller: CommandPoller
    presence: Presence
    revocations: RevocationFile
    subject_sync: SubjectSync
    _unread: str | None = field(default=None, init=False)

    def reasons(self) -> list[str]:
        """Why the gateway is not healthy; empty where it is."""
        faults = {
            "broker": self.broker.fault,
            "spool": self.worker.fault or self._unread,
            "cloud": self.forwarder.fault,
            "commands": self.command_poller.fault,
            "revocations": self.revocations.fault,
            "subjects": self.subject_sync.fault,
        }
        return [f"{part}: {fault}" for part, fault in faults.items() if fault is not None]

    def report(self) -> dict[str, Any]:
        """All of it, as ``/healthz`` answers."""
        spool, receive_queue = self.spool.statistics, self.receive_queue.statistics
        oldest_age = self.oldest_age()
        reasons = self.reasons()
        return {
            "status": "degraded" if reasons else "ok",
            "reasons": reasons,
            "broker": {"connected": self.broker.connected},
            "cloud": {"reachable": self.forwarder.reachable},
            "inbox": {
                "messages": receive_queue.depth,
                "capacity": receive_queue.capacity,
                "most": receive_queue.most,
                "refused": receive_queue.refused,
                "bytes": receive_queue.used,
            },
            "spool": {
                "messages": spool.messages,
                "bytes": spool.used,
                "capacity_bytes": spool.capacity,
                "oldest_age_s": oldest_age,
                "left_out": self.forwarder.left_out,
                "dead_letters": spool.dead_letters,
                "dropped_letters": spool.dropped_letters,
            },
            "nodes": {"online": self.presence.online},
        }

    def oldest_age(self) -> float | None:
        """Seconds since the oldest message in the spool came; ``None`` where there is none.

        NaN where the spool cannot be read: no other figure shall be missing for it.
        """
        try:
            oldest = self.spool.oldest()
        except SpoolError as error:
            self._unread = str(error)
            return math.nan
        self._unread = None
        return None if oldest is None else max(0.0, (time.time_ns() - oldest) / 1e9)

    def export(self, metrics: Metrics) -> None:
        """Add the parts' own figures to the counters."""
        spool, receive_queue, broker = self.spool, self.receive_queue, self.broker
        gauges: dict[str, tuple[str, Callable[[], float]]] = {
            "spool_messages": ("messages in the spool", lambda: spool.statistics.messages),
            "spool_bytes": ("bytes of messages in the spool", lambda: spool.statistics.used),
            "spool_capacity_bytes": ("its capacity", lambda: spool.statistics.capacity),
            "spool_oldest_seconds": ("age of its oldest", lambda: self.oldest_age() or 0.0),
            "dead_letters": ("dead letters kept", lambda: spool.statistics.dead_letters),
            "dead_letters_dropped": (
                "dead letters that gave way to newer ones",
                lambda: spool.statistics.dropped_letters,
            ),
            "spool_left_out": (
                "messages in the spool that the cloud fails at",
                lambda: self.forwarder.left_out,
            ),
            "inbox_messages": ("messages in the inbox", lambda: receive_queue.statistics.depth),
            "inbox_bytes": ("their bytes", lambda: receive_queue.statistics.used),
            "inbox_most": ("most messages ever in it", lambda: receive_queue.statistics.most),
            "inbox_refused": (
                "messages that found it full",
                lambda: receive_queue.statistics.refused,
            ),
            "publications_dropped": ("publications without a broker", lambda: broker.dropped),
            "broker_connected": ("1 while connected", lambda: broker.connected),
            "cloud_reachable": (
                "1 while the cloud answers",
                lambda: self.forwarder.reachable is True,
            ),
            "nodes_online": ("nodes heard lately", lambda: self.presence.online),
            "healthy": ("1 while nothing is wrong", lambda: not self.reasons()),
        }
        for name, (text, read) in gauges.items():
            metrics.gauge(name, text, read)
