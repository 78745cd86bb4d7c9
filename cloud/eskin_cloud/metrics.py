"""Metrics for Prometheus, in a registry of their own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

from eskin.errors import StoreError
from eskin_cloud.query.clock_check import count_wrong_clocks
from eskin_cloud.query.listing import sealed_nodes
from eskin_cloud.store.damage import damaged_rows
from eskin_cloud.store.disk_usage import measure_disk
from eskin_cloud.store.write.alarms import count_failing_receivers, count_open_alarms
from eskin_cloud.store.write.missing_messages import count_missing

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import Connection

    from eskin_cloud.commands.command_queue import Notifier
    from eskin_cloud.live import Feed
    from eskin_cloud.store import Store


class Metrics:
    """What a cloud counts.

    Args:
        store: Where messages are.
        feed: The live feed.
        notifier: Where gateways wait for commands.
        clock_error: Greatest error of gateways' and clouds' clocks, ns.

    Attributes:
        items: Messages that gateways brought, by result.
        ingest_seconds: From a batch's last byte to its commit.
        conflicts: Messages that differ from those stored under their boot and sequence.
        dead_letters_dropped: Dead letters dropped to make room.
        removed: Messages removed, by reason.
        requests: Answered requests, by method and status.
        faults: Unexpected errors of background jobs, by job.
        alarms_given_up: Changes of alarms that a receiver was not given, by receiver.
    """

    def __init__(self, store: Store, feed: Feed, notifier: Notifier, *, clock_error: int) -> None:
        self._registry = CollectorRegistry()
        self._store = store
        self._sealed = False
        self._look()
        self.items = self._counter(
            "items",
            "Messages that gateways brought, without sealed ones: a peak may be a heartbeat.",
            "result",
        )
        self.ingest_seconds = Histogram(
            "eskin_cloud_ingest_seconds",
            "From a batch's last byte to its commit, of batches with more than sealed messages.",
            registry=self._registry,
        )
        self.conflicts = self._counter(
            "conflicts", "Messages that differ from those stored under their boot and sequence."
        )
        self.dead_letters_dropped = self._counter(
            "dead_letters_dropped", "Dead letters dropped to make room."
        )
        self.removed = self._counter(
            "removed", "Messages removed, by reason: too old, or of an erased subject.", "reason"
        )
        self.requests = self._counter("requests", "Answered requests.", "method", "status")
        self.faults = self._counter(
            "faults", "Unexpected errors of background jobs, which were retried.", "work"
        )
        self.alarms_given_up = self._counter(
            "alarms_given_up", "Changes of alarms that a webhook never took.", "receiver"
        )
        self._store_gauge(
            "alarms_open", "Alarms that are raised and not cleared.", count_open_alarms
        )
        self._store_gauge(
            "alarm_receivers_failing",
            "Receivers of alarms whose latest attempt failed.",
            count_failing_receivers,
        )
        self._gauge("subscribers", "Live streams.", lambda: feed.subscribers)
        self._gauge("waiting", "Gateways that wait for commands.", lambda: notifier.waiting)
        self._store_gauge(
            "wrong_clocks",
            "Nodes whose latest status proves that their clock is beyond its bound.",
            lambda connection: count_wrong_clocks(connection, clock_error),
        )
        self._store_gauge(
            "messages_missing",
            "Messages that nodes made and that are stored nowhere, though no gap names them.",
            count_missing,
        )
        self._watch(store)

    def write(self) -> bytes:
        """All metrics in Prometheus' text format."""
        self._look()
        return generate_latest(self._registry)

    def _look(self) -> None:
        self._use = measure_disk(self._store)
        try:
            with self._store.read() as connection:
                self._sealed = bool(sealed_nodes(connection))
        except StoreError:
            self._sealed = True
        if self._sealed:
            self._use = self._use.coarse()

    def _watch(self, store: Store) -> None:
        self._gauge("writes_waiting", "Writes that wait.", lambda: store.waiting)
        self._gauge("store_bytes", "What the store takes of the disk.", lambda: self._use.taken)
        self._gauge(
            "store_free_bytes",
            "Of these, what is free for what comes next; 0 where the server does not report it.",
            lambda: self._use.free,
        )
        self._gauge("samples", "Samples in the store.", lambda: self._use.samples)
        self._gauge(
            "store_bytes_per_sample",
            "Bytes a sample, of what is taken and not free.",
            lambda: self._use.each or 0.0,
        )
        self._gauge(
            "damaged_rows",
            "Rows met since the start that are not as they were written; the log names them.",
            lambda: len(damaged_rows),
        )
        self._gauge(
            "commits",
            "Commits since the start; NaN where biometric channels are, whose beats it would show.",
            lambda: math.nan if self._sealed else store.commits,
        )
        self._gauge(
            "store_fault", "1 while the store cannot be written.", lambda: bool(store.fault)
        )

    def _counter(self, name: str, text: str, *labels: str) -> Counter:
        return Counter(f"eskin_cloud_{name}", text, labels, registry=self._registry)

    def _gauge(self, name: str, text: str, read: Callable[[], float]) -> None:
        gauge = Gauge(f"eskin_cloud_{name}", text, registry=self._registry)
        gauge.set_function(read)

    def _store_gauge(self, name: str, text: str, count: Callable[[Connection], int]) -> None:
        """Register a gauge that reads the store; NaN while the store cannot be read."""

        def read() -> float:
            try:
                with self._store.read() as connection:
                    return count(connection)
            except StoreError:
                return math.nan

        self._gauge(name, text, read)
