"""Prometheus metrics of the gateway."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

if TYPE_CHECKING:
    from collections.abc import Callable

_LATENCY_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 60.0, 600.0, 3600.0, 86_400.0)


class RejectReason(StrEnum):
    """Why a message is rejected: label of the counter and in logs."""

    TOPIC = "topic"
    OVERSIZED = "oversized"
    MALFORMED = "malformed"
    WRONG_RECIPIENT = "wrong_recipient"
    UNKNOWN_SENDER = "unknown_sender"
    UNTRUSTED = "untrusted"
    FORGED = "forged"
    MISADDRESSED = "misaddressed"
    UNREADABLE = "unreadable"
    TOO_MANY_DESCRIPTIONS = "too_many_descriptions"
    INTERNAL_ERROR = "internal_error"


class Metrics:
    """All metrics of one gateway, in a registry of its own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.received = self._count("messages_received", "messages from the broker")
        self.accepted = self._count("messages_accepted", "messages committed to the spool")
        self.duplicate = self._count("messages_duplicate", "messages that were committed before")
        self.waiting = self._count(
            "messages_waiting", "messages not acknowledged, as their layout was missing"
        )
        self.acknowledged = self._count("messages_acknowledged", "positions acknowledged to nodes")
        self.commands = self._count("commands_published", "commands sent to the broker")
        self.command_results = self._count("commands_answered", "results of commands committed")
        self.published = self._count("publications", "public messages sent to the broker")
        self.batches = self._count("batches", "commits of the spool")
        self.commit_failures = self._count("spool_commit_failures", "commits that failed")
        self.forwarded = self._count("messages_forwarded", "messages sent to the cloud")
        self.stored = self._count("messages_stored", "messages that the cloud stored")
        self.cloud_duplicate = self._count("cloud_duplicate", "messages that the cloud had already")
        self.cloud_rejected = self._count("cloud_rejected", "messages that the cloud rejected")
        self.cloud_failures = self._count("cloud_failures", "requests to the cloud that failed")
        self._rejected = Counter(
            "eskin_gateway_messages_rejected",
            "rejected messages, by reason",
            ["reason"],
            registry=self.registry,
        )
        self.latency = Histogram(
            "eskin_gateway_forward_latency_seconds",
            "from a message's receipt to the cloud's response (the oldest of each batch)",
            buckets=_LATENCY_S,
            registry=self.registry,
        )
        for reason in RejectReason:
            self._rejected.labels(reason)

    def rejected(self, reason: RejectReason, count: int = 1) -> None:
        """Count rejected messages."""
        self._rejected.labels(reason).inc(count)

    def value(self, name: str, **labels: str) -> float:
        """One value, such as ``messages_accepted_total``."""
        return self.registry.get_sample_value(f"eskin_gateway_{name}", labels) or 0.0

    def gauge(self, name: str, text: str, read: Callable[[], float]) -> None:
        """Add a value that is read when it is collected."""
        Gauge(f"eskin_gateway_{name}", text, registry=self.registry).set_function(read)

    def _count(self, name: str, text: str) -> Counter:
        return Counter(f"eskin_gateway_{name}", text, registry=self.registry)
