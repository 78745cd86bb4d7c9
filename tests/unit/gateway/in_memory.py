"""A gateway without a network: its parts around an in-memory broker."""

from __future__ import annotations

from datetime import UTC, datetime
from random import Random
from typing import TYPE_CHECKING

from eskin_gateway.commands.publisher import CommandPublisher, PendingCommands
from eskin_gateway.ingest.biometric import BiometricEncryptor
from eskin_gateway.ingest.commit_loop import CommitLoop, PostCommit
from eskin_gateway.ingest.missing_layouts import MissingLayouts
from eskin_gateway.ingest.validator import Validator
from eskin_gateway.metrics import Metrics
from eskin_gateway.mqtt.receive_queue import ReceiveQueue
from eskin_gateway.mqtt.sealer_cache import SealerCache
from eskin_gateway.mqtt.transport import ReceivedMessage
from eskin_gateway.publish.alarms import AlarmPublisher
from eskin_gateway.publish.homeassistant import Discovery
from eskin_gateway.publish.presence import Presence
from eskin_gateway.settings import SpoolSection
from eskin_gateway.spool.descriptions import Descriptions
from eskin_gateway.spool.node_certificates import NodeCertificates
from eskin_gateway.spool.node_state import NodeStates
from eskin_gateway.spool.spool import Spool
from eskin_gateway.spool.subject_assignments import SubjectAssignments

from eskin.errors import SpoolError
from eskin.identity import ChainVerifier, IdentityKind, RevocationFile
from eskin.privacy import open_keystore
from eskin.runtime.settings import KeysSection
from eskin.runtime.supervised import Backoff
from eskin.wire.envelope import Opener
from eskin.wire.topics import Stream, node_topic
from tests.unit.gateway.messages import DESCRIPTIONS, EPOCH, status

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from eskin_gateway.spool.batch import Batch

    from tests.support.identities import Identities
    from tests.unit.gateway.wire_node import Seal

LAYOUT_WAIT_S = 600.0
DAY_NS = 86_400 * 10**9
"""Age of a status at which a node expires, in tests."""


class MemoryBroker:
    """Records what the gateway publishes."""

    def __init__(self) -> None:
        self.connected = True
        self.released: list[int] = []
        self.published: list[tuple[str, bytes, bool]] = []

    def acknowledge(self, received_messages: Sequence[ReceivedMessage]) -> None:
        self.released += [received_message.mid for received_message in received_messages]

    def publish(self, publications: Iterable[tuple[str, bytes, bool]]) -> None:
        self.published += publications

    def on(self, topic: str) -> list[bytes]:
        return [payload for published, payload, _ in self.published if published == topic]


class FaultySpool(Spool):
    """Fails ``failures`` times before anything is written."""

    failures = 0

    def commit(self, batch: Batch) -> None:
        if self.failures:
            self.failures -= 1
            raise SpoolError("database or disk is full")
        super().commit(batch)


class Clock:
    """Advanced by the test."""

    def __init__(self) -> None:
        self.seconds = 1000.0
        self.wall = datetime.now(UTC)

    def __call__(self) -> float:
        return self.seconds

    def now(self) -> datetime:
        return self.wall


class Inside:
    """Validator, spool and publishers of a gateway around the in-memory broker."""

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
        self.metrics = Metrics()
        self.spool = FaultySpool(folder / "spool.db", capacity=4_000_000, max_dead_letters=50)
        self._make_keys(folder / "keys")
        self.trust = ChainVerifier(*identities.gateway.roots, clock=self.clock.now)
        self.revocations = RevocationFile(self.trust, IdentityKind.NODE, revocations)
        self.node_certificates = NodeCertificates(
            self.spool,
            self.trust,
            revocations=self.revocations,
            site=identities.gateway.site,
            clock=self.clock,
        )
        self.node_states = NodeStates(self.spool)
        self.descriptions = Descriptions(self.spool)
        self.presence = Presence(15.0)
        self.receive_queue = ReceiveQueue(1000, most_bytes=10_000_000)
        self.validator = Validator(
            opener=Opener([identities.site], sender=self.node_certificates.find),
            node_certificates=self.node_certificates,
            node_states=self.node_states,
            descriptions=self.descriptions,
            missing_layouts=MissingLayouts(LAYOUT_WAIT_S, self.clock),
            encryptor=self.encryptor,
        )
        sealer_cache = SealerCache(lambda _: identities.site)
        self.alarms = AlarmPublisher("homeassistant" if homeassistant else None)
        self.post_commit = self._make_answers(sealer_cache, homeassistant=homeassistant)
        self.commands = PendingCommands(5.0)
        self.command_publisher = CommandPublisher(
            self.commands,
            broker=self.broker,
            sealer_cache=sealer_cache,
            node_certificates=self.node_certificates,
            metrics=self.metrics,
            clock=self.clock,
        )
        self.commit_loop = CommitLoop(
            SpoolSection(path=folder / "spool.db"),
            receive_queue=self.receive_queue,
            validator=self.validator,
            spool=self.spool,
            post_commit=self.post_commit,
            command_publisher=self.command_publisher,
            metrics=self.metrics,
        )
        self._mid = 0

    def _make_answers(self, sealer_cache: SealerCache, *, homeassistant: bool) -> PostCommit:
        return PostCommit(
            broker=self.broker,
            sealer_cache=sealer_cache,
            node_certificates=self.node_certificates,
            presence=self.presence,
            alarms=self.alarms,
            descriptions=self.descriptions,
            metrics=self.metrics,
            discovery=self._make_discovery() if homeassistant else None,
            clock=self.clock,
        )

    def _make_discovery(self) -> Discovery:
        return Discovery(
            "homeassistant",
            expire_ns=DAY_NS,
            spool=self.spool,
            node_certificates=self.node_certificates,
            descriptions=self.descriptions,
            now=lambda: EPOCH + int((self.clock() - 1000) * 1e9),
        )

    def _make_keys(self, folder: Path) -> None:
        self.keystore = open_keystore(KeysSection(), folder)
        self.assignments = SubjectAssignments(self.keystore)
        self.encryptor = BiometricEncryptor(self.assignments)

    def arrive(
        self, stream: Stream, envelope: bytes, *, node: str = "fingertip", retained: bool = False
    ) -> None:
        """Receive and process one message."""
        self.commit_loop.process(
            [self.received_message(stream, envelope, node=node, retained=retained)]
        )

    def introduce(self, seal: Seal, *, node: str = "fingertip") -> None:
        """Receive a node's first status, and what describes its skin of one channel."""
        introduction = seal(node, Stream.STATUS, status(0).encode(), introduce=True)
        self.arrive(Stream.STATUS, introduction, node=node)
        self.describe(seal, node=node)

    def describe(self, seal: Seal, *, node: str = "fingertip") -> None:
        """Receive what describes the skin of one channel."""
        for each in DESCRIPTIONS:
            self.arrive(Stream.LAYOUTS, seal(node, Stream.LAYOUTS, each.encode()), node=node)

    def received_message(
        self, stream: Stream, envelope: bytes, *, node: str = "fingertip", retained: bool = False
    ) -> ReceivedMessage:
        """A message as the broker would deliver it."""
        self._mid += 1
        return ReceivedMessage(node_topic(node, stream), envelope, self._mid, 1, retained, 1)

    def stored(self) -> list[bytes]:
        """Plaintexts in the spool."""
        return [message.body for message in self.spool.take(10_000, 10**9)]

    def rejected(self) -> dict[str, int]:
        """Rejected messages by reason."""
        found = {}
        for metric in self.metrics.registry.collect():
            for sample in metric.samples:
                if sample.name == "eskin_gateway_messages_rejected_total" and sample.value:
                    found[sample.labels["reason"]] = int(sample.value)
        return found


def quick() -> Backoff:
    """A backoff with short delays."""
    return Backoff(0.01, 0.05, random=Random(1))  # noqa: S311 - jitter, repeatable
