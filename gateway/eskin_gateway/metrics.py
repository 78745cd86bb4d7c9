"""What is counted, for Prometheus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

from eskin_gateway.reject_reason import RejectReason

if TYPE_CHECKING:
    from collections.abc import Callable

_LATENCY_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 60.0, 600.0, 3600.0, 86_400.0)


class Metrics:
    """All figures of one gateway, in a registry of its own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.received = self._count("messages_received", "messages that the broker delivered")
        self.accepted = self._count("messages_accepted", "messages made durable")
        self.duplicate = self._count("messages_duplicate", "messages that were durable already")
        self.acknowledged = self._count("messages_acknowledged", "positions acknowledged to nodes")
        self.commands = self._count("commands_published", "commands handed to the broker")
        self.answers = self._count("commands_answered", "results of commands made durable")
        self.published = self._count("publications", "public messages handed to the broker")
        self.batches = self._count("batches", "commits of the spool")
        self.refusals = self._count("spool_refusals", "commits that found no room or failed")
        self.forwarded = self._count("messages_forwarded", "messages sent to the cloud")
        self.stored = self._count("messages_stored", "messages that the cloud stored")
        self.cloud_duplicate = self._count("cloud_duplicate", "messages that the cloud had already")
        self.cloud_rejected = self._count("cloud_rejected", "messages that the cloud rejected")
        self.cloud_failures = self._count("cloud_failures", "requests without a proper answer")
        self._rejected = Counter(
            "eskin_gateway_messages_rejected",
            "messages refused, by reason",
            ["reason"],
            registry=self.registry,
        )
        self.latency = Histogram(
            "eskin_gateway_forward_latency_seconds",
            "from a message's arrival to the cloud's answer (the oldest of each batch)",
            buckets=_LATENCY_S,
            registry=self.registry,
        )
        for reason in RejectReason:
            self._rejected.labels(reason)

    def rejected(self, reason: RejectReason, count: int = 1) -> None:
        """Count refusals."""
        self._rejected.labels(reason).inc(count)

    def value(self, name: str, **labels: str) -> float:
        """One figure, such as ``messages_accepted_total``."""
        return self.registry.get_sample_value(f"eskin_gateway_{name}", labels) or 0.0

    def gauge(self, name: str, text: str, read: Callable[[], float]) -> None:
        """Add a figure that is read when asked for."""
        Gauge(f"eskin_gateway_{name}", text, registry=self.registry).set_function(read)

    def _count(self, name: str, text: str) -> Counter:
        return Counter(f"eskin_gateway_{name}", text, registry=self.registry)
