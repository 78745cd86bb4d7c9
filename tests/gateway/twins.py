"""In-memory twins of the gateway's seams, and a gateway's inside put together with them."""

from __future__ import annotations

from datetime import UTC, datetime
from random import Random
from typing import TYPE_CHECKING

from eskin.envelope import Opener
from eskin.errors import SpoolError
from eskin.identity import IdentityKind, RevocationFile, Trust
from eskin.privacy import open_vault
from eskin.settings import KeysSection
from eskin.topics import Stream, node_topic
from gateway.acknowledger import Acknowledger
from gateway.answers import Answers
from gateway.arrival import Arrival
from gateway.assignments import Assignments
from gateway.backoff import Backoff
from gateway.commands import Commands
from gateway.counters import Counters
from gateway.discovery import Discovery
from gateway.dispatcher import Dispatcher
from gateway.inbox import Inbox
from gateway.intake import Intake
from gateway.onlookers import Onlookers
from gateway.presence import Presence
from gateway.records import Records
from gateway.sealers import Sealers
from gateway.senders import Senders
from gateway.settings import SpoolSection
from gateway.spool import Spool
from gateway.veiling import Veiling
from gateway.worker import Worker
from tests.gateway.messages import EPOCH

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from gateway.batch import Batch
    from tests.identities import Identities

DAY_NS = 86_400 * 10**9
"""After so long without a word a node is gone, in tests."""


class MemoryBroker:
    """Keeps what the gateway hands over."""

    def __init__(self) -> None:
        self.connected = True
        self.released: list[int] = []
        self.published: list[tuple[str, bytes, bool]] = []

    def acknowledge(self, arrivals: Sequence[Arrival]) -> None:
        self.released += [arrival.mid for arrival in arrivals]

    def publish(self, publications: Iterable[tuple[str, bytes, bool]]) -> None:
        self.published += publications

    def on(self, topic: str) -> list[bytes]:
        return [payload for published, payload, _ in self.published if published == topic]


class FaultySpool(Spool):
    """Fails as often as it is told to, before anything is written."""

    failures = 0

    def commit(self, batch: Batch) -> None:
        if self.failures:
            self.failures -= 1
            raise SpoolError("database or disk is full")
        super().commit(batch)


class Clock:
    """Turned by hand."""

    def __init__(self) -> None:
        self.seconds = 1000.0
        self.wall = datetime.now(UTC)

    def __call__(self) -> float:
        return self.seconds

    def now(self) -> datetime:
        return self.wall


class Inside:
    """Intake, spool and answers of a gateway around the in-memory broker."""

    def __init__(
        self,
        folder: Path,
        identities: Identities,
        *,
        revocations: Path | None = None,
        homeassistant: bool = False,
    ) -> None:
        self.clock = Clock()
        self.broker = MemoryBroker()
        self.counters = Counters()
        self.onlookers = Onlookers(self.clock)
        self.spool = FaultySpool(folder / "spool.db", capacity=4_000_000, letters=50)
        self._make_keys(folder / "keys")
        self.trust = Trust(*identities.gateway.roots, clock=self.clock.now)
        self.revocations = RevocationFile(self.trust, IdentityKind.NODE, revocations)
        self.senders = Senders(
            self.spool,
            self.trust,
            revocations=self.revocations,
            site=identities.gateway.site,
            clock=self.clock,
        )
        self.records = Records(self.spool)
        self.presence = Presence(15.0)
        self.inbox = Inbox(1000, most_bytes=10_000_000)
        self.intake = Intake(
            opener=Opener([identities.site], sender=self.senders.find),
            senders=self.senders,
            records=self.records,
            veiling=self.veiling,
        )
        sealers = Sealers(lambda _: identities.site)
        self.answers = self._make_answers(sealers, homeassistant=homeassistant)
        self.commands = Commands(5.0)
        self.dispatcher = Dispatcher(
            self.commands,
            broker=self.broker,
            sealers=sealers,
            senders=self.senders,
            spool=self.spool,
            counters=self.counters,
            clock=self.clock,
        )
        self.worker = Worker(
            SpoolSection(path=folder / "spool.db"),
            inbox=self.inbox,
            intake=self.intake,
            spool=self.spool,
            answers=self.answers,
            dispatcher=self.dispatcher,
            counters=self.counters,
        )
        self._mid = 0

    def _make_answers(self, sealers: Sealers, *, homeassistant: bool) -> Answers:
        return Answers(
            broker=self.broker,
            acknowledger=Acknowledger(sealers),
            senders=self.senders,
            presence=self.presence,
            counters=self.counters,
            onlookers=self.onlookers,
            discovery=self._make_discovery() if homeassistant else None,
            clock=self.clock,
        )

    def _make_discovery(self) -> Discovery:
        return Discovery(
            "homeassistant",
            forget_ns=DAY_NS,
            spool=self.spool,
            senders=self.senders,
            now=lambda: EPOCH + int((self.clock() - 1000) * 1e9),
        )

    def _make_keys(self, folder: Path) -> None:
        self.vault = open_vault(KeysSection(), folder)
        self.assignments = Assignments(self.vault)
        self.veiling = Veiling(self.assignments)

    def arrive(
        self, stream: Stream, envelope: bytes, *, node: str = "fingertip", retained: bool = False
    ) -> None:
        """One message comes and is worked off."""
        self.worker.process([self.arrival(stream, envelope, node=node, retained=retained)])

    def arrival(
        self, stream: Stream, envelope: bytes, *, node: str = "fingertip", retained: bool = False
    ) -> Arrival:
        """A message as the broker would deliver it."""
        self._mid += 1
        return Arrival(node_topic(node, stream), envelope, self._mid, 1, retained, 1)

    def stored(self) -> list[bytes]:
        """Plaintexts in the spool."""
        return [message.body for message in self.spool.take(10_000, 10**9)]

    def rejected(self) -> dict[str, int]:
        """Refusals by reason."""
        found = {}
        for metric in self.counters.registry.collect():
            for sample in metric.samples:
                if sample.name == "eskin_gateway_messages_rejected_total" and sample.value:
                    found[sample.labels["reason"]] = int(sample.value)
        return found


def quick() -> Backoff:
    """Hardly waits."""
    return Backoff(0.01, 0.05, random=Random(1))  # noqa: S311 - jitter, repeatable
