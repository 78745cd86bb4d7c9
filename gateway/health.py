"""How the gateway fares, for people and for supervisors."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from gateway.counters import Counters
    from gateway.courier import Courier
    from gateway.forwarder import Forwarder
    from gateway.inbox import Inbox
    from gateway.mqtt import MqttBroker
    from gateway.presence import Presence
    from gateway.revocations import Revocations
    from gateway.spool import Spool
    from gateway.worker import Worker


class Health:
    """Asks all parts; holds nothing itself."""

    def __init__(
        self,
        *,
        broker: MqttBroker,
        inbox: Inbox,
        worker: Worker,
        spool: Spool,
        forwarder: Forwarder,
        courier: Courier,
        presence: Presence,
        revocations: Revocations,
    ) -> None:
        self._broker = broker
        self._inbox = inbox
        self._worker = worker
        self._spool = spool
        self._forwarder = forwarder
        self._courier = courier
        self._presence = presence
        self._revocations = revocations

    def reasons(self) -> list[str]:
        """Why the gateway is not healthy; empty where it is."""
        faults = {
            "broker": self._broker.fault,
            "spool": self._worker.fault,
            "cloud": self._forwarder.fault,
            "commands": self._courier.fault,
            "revocations": self._revocations.fault,
        }
        return [f"{part}: {fault}" for part, fault in faults.items() if fault is not None]

    def report(self) -> dict[str, Any]:
        """All of it, as ``/healthz`` answers."""
        spool, inbox = self._spool.statistics, self._inbox.statistics
        reasons = self.reasons()
        return {
            "status": "degraded" if reasons else "ok",
            "reasons": reasons,
            "broker": {"connected": self._broker.connected},
            "cloud": {"reachable": self._forwarder.reachable},
            "inbox": {
                "messages": inbox.depth,
                "capacity": inbox.capacity,
                "most": inbox.most,
                "refused": inbox.refused,
                "bytes": inbox.used,
            },
            "spool": {
                "messages": spool.messages,
                "bytes": spool.used,
                "capacity_bytes": spool.capacity,
                "oldest_age_s": self.oldest_age(),
                "left_out": self._forwarder.left_out,
                "dead_letters": spool.dead_letters,
                "dropped_letters": spool.dropped_letters,
            },
            "nodes": {"online": self._presence.online},
        }

    def oldest_age(self) -> float | None:
        """Seconds since the oldest message in the spool came; ``None`` where there is none."""
        oldest = self._spool.oldest()
        return None if oldest is None else max(0.0, (time.time_ns() - oldest) / 1e9)

    def export(self, counters: Counters) -> None:
        """Add the parts' own figures to the counters."""
        spool, inbox, broker = self._spool, self._inbox, self._broker
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
                lambda: self._forwarder.left_out,
            ),
            "inbox_messages": ("messages in the inbox", lambda: inbox.statistics.depth),
            "inbox_bytes": ("their bytes", lambda: inbox.statistics.used),
            "inbox_most": ("most messages ever in it", lambda: inbox.statistics.most),
            "inbox_refused": ("messages that found it full", lambda: inbox.statistics.refused),
            "publications_dropped": ("publications without a broker", lambda: broker.dropped),
            "broker_connected": ("1 while connected", lambda: broker.connected),
            "cloud_reachable": (
                "1 while the cloud answers",
                lambda: self._forwarder.reachable is True,
            ),
            "nodes_online": ("nodes heard lately", lambda: self._presence.online),
            "healthy": ("1 while nothing is wrong", lambda: not self.reasons()),
        }
        for name, (text, read) in gauges.items():
            counters.gauge(name, text, read)
