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
    from gateway.counters import Counters
    from gateway.courier import Courier
    from gateway.forwarder import Forwarder
    from gateway.inbox import Inbox
    from gateway.mqtt import MqttBroker
    from gateway.presence import Presence
    from gateway.spool import Spool
    from gateway.steward import Steward
    from gateway.worker import Worker


@dataclass(kw_only=True, slots=True)
class Health:
    """Asks all parts; holds nothing itself."""

    broker: MqttBroker
    inbox: Inbox
    worker: Worker
    spool: Spool
    forwarder: Forwarder
    courier: Courier
    presence: Presence
    revocations: RevocationFile
    steward: Steward
    _unread: str | None = field(default=None, init=False)

    def reasons(self) -> list[str]:
        """Why the gateway is not healthy; empty where it is."""
        faults = {
            "broker": self.broker.fault,
            "spool": self.worker.fault or self._unread,
            "cloud": self.forwarder.fault,
            "commands": self.courier.fault,
            "revocations": self.revocations.fault,
            "subjects": self.steward.fault,
        }
        return [f"{part}: {fault}" for part, fault in faults.items() if fault is not None]

    def report(self) -> dict[str, Any]:
        """All of it, as ``/healthz`` answers."""
        spool, inbox = self.spool.statistics, self.inbox.statistics
        oldest_age = self.oldest_age()
        reasons = self.reasons()
        return {
            "status": "degraded" if reasons else "ok",
            "reasons": reasons,
            "broker": {"connected": self.broker.connected},
            "cloud": {"reachable": self.forwarder.reachable},
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

    def export(self, counters: Counters) -> None:
        """Add the parts' own figures to the counters."""
        spool, inbox, broker = self.spool, self.inbox, self.broker
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
            "inbox_messages": ("messages in the inbox", lambda: inbox.statistics.depth),
            "inbox_bytes": ("their bytes", lambda: inbox.statistics.used),
            "inbox_most": ("most messages ever in it", lambda: inbox.statistics.most),
            "inbox_refused": ("messages that found it full", lambda: inbox.statistics.refused),
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
            counters.gauge(name, text, read)
