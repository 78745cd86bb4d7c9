"""A forwarder between a spool with messages and a cloud, for tests."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Literal

from eskin_gateway.forward.forwarder import Forwarder
from eskin_gateway.metrics import Metrics
from eskin_gateway.settings import CloudSection
from eskin_gateway.spool.batch import Batch, SpoolMessage
from eskin_gateway.spool.spool import Spool
from eskin_gateway.upstream.ingest_client import IngestClient, ItemResult

from eskin.errors import CloudError
from tests.unit.gateway.certificates import KnownNodes
from tests.unit.gateway.descriptions import KnownDescriptions
from tests.unit.gateway.in_memory import quick

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from tests.unit.gateway.stub_cloud import StubCloud

MESSAGES = [("n", bytes([number])) for number in range(10)]


class MemoryCloud(IngestClient):
    """Stores messages in memory, or fails by ``mode``; ``failing`` are bodies at which it fails.

    Attributes:
        failure: How it answers to those; ``None``: not at all.
        asked: The bodies of each request.
    """

    def __init__(self) -> None:
        self.mode = "ok"
        self.failing: set[bytes] = set()
        self.failure: int | None = 500
        self.stored: list[tuple[str, bytes]] = []
        self.asked: list[list[bytes]] = []

    @property
    def url(self) -> str:
        return "memory"

    def shares(self, messages: Sequence[SpoolMessage]) -> list[list[SpoolMessage]]:
        return [list(messages)] if messages else []

    def send(self, messages: Sequence[tuple[str, bytes]]) -> list[ItemResult]:
        self.asked.append([body for _, body in messages])
        if self.mode in {"error", "busy", "nonsense", "short"}:
            status = {"error": 500, "busy": 503}.get(self.mode)
            raise CloudError("stated to fail", status=status)
        if any(body in self.failing for _, body in messages):
            raise CloudError("broken by a message", status=self.failure)
        if self.mode == "large" and len(messages) > 2:
            raise CloudError("too large", status=413)
        return [self._store(message) for message in messages]

    def _store(self, message: tuple[str, bytes]) -> ItemResult:
        result: Literal["stored", "duplicate"] = "duplicate" if message in self.stored else "stored"
        if self.mode == "reject":
            return ItemResult("rejected", "not wanted")
        if result == "stored":
            self.stored.append(message)
        return ItemResult(result, None)


class Setup:
    """A forwarder between a spool with ten messages and a cloud."""

    def __init__(
        self,
        folder: Path,
        cloud: IngestClient,
        stub: StubCloud | MemoryCloud,
        *,
        most: int = 4,
        descriptions: KnownDescriptions | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.cloud = stub
        self.spool = Spool(folder / "spool.db", capacity=10**7, max_dead_letters=100)
        self.spool.commit(Batch([SpoolMessage(node, 1, body) for node, body in MESSAGES]))
        self.metrics = Metrics()
        self.certificates = KnownNodes()
        self.forwarder = Forwarder(
            CloudSection(batch_messages=most),
            spool=self.spool,
            ingest_client=cloud,
            certificates_client=self.certificates,
            descriptions_client=descriptions or KnownDescriptions(),
            backoff=quick(),
            metrics=self.metrics,
            clock=clock,
        )
