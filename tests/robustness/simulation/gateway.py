"""A gateway: the product's parts from the receive queue to the cloud, without their threads."""

from __future__ import annotations

import sqlite3
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Final

import httpx
from eskin_gateway.commands.publisher import CommandPublisher, PendingCommands
from eskin_gateway.forward.forwarder import Forwarder
from eskin_gateway.forward.status_report import StatusReport
from eskin_gateway.ingest.biometric import BiometricEncryptor
from eskin_gateway.ingest.commit_loop import CommitLoop, PostCommit
from eskin_gateway.ingest.missing_layouts import MissingLayouts
from eskin_gateway.ingest.validator import Validator
from eskin_gateway.metrics import Metrics
from eskin_gateway.mqtt.receive_queue import ReceiveQueue
from eskin_gateway.mqtt.sealer_cache import SealerCache
from eskin_gateway.mqtt.transport import ReceivedMessage
from eskin_gateway.ops.subject_sync import SubjectSync
from eskin_gateway.publish.alarms import AlarmPublisher
from eskin_gateway.publish.presence import Presence
from eskin_gateway.settings import CloudSection, SpoolSection
from eskin_gateway.spool.descriptions import Descriptions
from eskin_gateway.spool.node_certificates import NodeCertificates
from eskin_gateway.spool.node_state import NodeStates
from eskin_gateway.spool.spool import Spool
from eskin_gateway.spool.subject_assignments import SubjectAssignments
from eskin_gateway.upstream.certificates_client import CertificatesClient
from eskin_gateway.upstream.cloud_client import CloudClient
from eskin_gateway.upstream.confirmations_client import ConfirmationsClient
from eskin_gateway.upstream.descriptions_client import DescriptionsClient
from eskin_gateway.upstream.ingest_client import IngestClient
from eskin_gateway.upstream.subjects_client import SubjectsClient

from eskin.errors import CloudError, SpoolError
from eskin.identity import IdentityKind, RevocationFile
from eskin.privacy import open_keystore
from eskin.runtime.settings import KeysSection
from eskin.runtime.supervised import Backoff
from eskin.wire.envelope import Opener
from eskin.wire.topics import Stream, parse_node_topic
from tests.robustness.simulation.timeline import EPOCH, SECOND, KilledError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from tests.robustness.simulation.faults import Fault
    from tests.robustness.simulation.world import World

_URL: Final = "https://cloud/api/v1/ingest"
_TICK_S: Final = 0.25
_CAPACITY: Final = 12_000
_BATCH: Final = 8
_SYNC_S: Final = 1.0
_FAIL: Final = """CREATE TRIGGER IF NOT EXISTS simulated_fault BEFORE INSERT ON nodes
    BEGIN SELECT RAISE(ROLLBACK, 'database or disk is full'); END"""
_WORK: Final = "DROP TRIGGER IF EXISTS simulated_fault"


class Gateway(httpx.BaseTransport):
    """One gateway; it is also its own connection to the broker, and to the cloud.

    Args:
        world: What it is part of.
        name: Its name.
        folder: Of its spool; the site's keys are there, too.

    Attributes:
        life: Counts starts and deaths.
        connected: Whether the broker reaches it.
        path: Its spool.
    """

    def __init__(self, world: World, name: str, folder: Path) -> None:
        self._world = world
        self.name = name
        self.path = folder / f"{name}.sqlite"
        self._keys = folder / "keys"
        self._latency = world.timeline.draws(f"latency of {name}")
        self.life = 0
        self.connected = False
        self._failing = False
        self._start()

    @property
    def waiting(self) -> int:
        """Messages in the spool; one at least while it is dead."""
        return self.spool.statistics.messages + len(self._received) if self.connected else 1

    @property
    def erasures(self) -> float:
        """Erasures that the cloud has not confirmed."""
        return self._subject_sync.pending

    def now(self) -> int:
        """UTC ns, as its clock has it."""
        off = self._world.faults.lasting(self.name, "has its clock set") is not None
        return EPOCH + self._world.timeline.now + (3600 * SECOND if off else 0)

    # Life.

    def _start(self) -> None:
        world, clock = self._world, self._world.timeline.monotonic
        parties = world.parties
        self.life += 1
        self.connected = True
        self._committing = False
        self._asking = 0
        self._received: list[tuple[str, ReceivedMessage]] = []
        self._set_failing(failing=False)
        self.spool = Spool(self.path, capacity=_CAPACITY, max_dead_letters=1000)
        metrics = Metrics()
        presence = Presence(15.0)
        presence.restore(self.spool, clock())
        self.keystore = open_keystore(KeysSection(), self._keys)
        self.assignments = SubjectAssignments(self.keystore)
        encryptor = BiometricEncryptor(self.assignments)
        certificates = NodeCertificates(
            self.spool,
            parties.verifier,
            revocations=RevocationFile(parties.verifier, IdentityKind.NODE, None, clock=clock),
            site=parties.gateways[self.name].site,
            clock=clock,
        )
        descriptions = Descriptions(self.spool)
        sealer_cache = SealerCache(lambda _: parties.site)
        self._commit_loop = CommitLoop(
            SpoolSection(path=self.path),
            receive_queue=ReceiveQueue(1, most_bytes=1),
            validator=Validator(
                opener=Opener([parties.site], sender=certificates.find),
                node_certificates=certificates,
                node_states=NodeStates(self.spool),
                descriptions=descriptions,
                missing_layouts=MissingLayouts(600.0, clock),
                encryptor=encryptor,
                now=self.now,
            ),
            spool=self.spool,
            post_commit=PostCommit(
                broker=self,
                sealer_cache=sealer_cache,
                node_certificates=certificates,
                presence=presence,
                alarms=AlarmPublisher(None),
                descriptions=descriptions,
                metrics=metrics,
                clock=clock,
                now=self.now,
            ),
            command_publisher=CommandPublisher(
                PendingCommands(5.0),
                broker=self,
                sealer_cache=sealer_cache,
                node_certificates=certificates,
                metrics=metrics,
                clock=clock,
            ),
            metrics=metrics,
            clock=clock,
            wait=self._wait_to_commit,
        )
        client = CloudClient(
            [_URL],
            headers=StatusReport(self.spool, presence, clock=clock, now=self.now).headers,
            context=parties.contexts[self.name],
            timeout_s=10.0,
            transport=self,
        )
        certificates_client = CertificatesClient(client, self.spool)
        self._subject_sync = SubjectSync(
            self.keystore,
            self.assignments,
            encryptor=encryptor,
            subjects_client=SubjectsClient(client),
            certificates_client=certificates_client,
            share=False,
            backoff=self._make_backoff("subjects"),
        )
        self._backoff = self._make_backoff("forwarder")
        self._forwarder = Forwarder(
            CloudSection(batch_messages=16),
            spool=self.spool,
            ingest_client=IngestClient(client),
            certificates_client=certificates_client,
            descriptions_client=DescriptionsClient(client, self.spool),
            backoff=self._backoff,
            metrics=metrics,
            confirmations_client=ConfirmationsClient(client, certificates_client),
            confirm_erasures=self._subject_sync.confirm_erasures,
            clock=clock,
            now=self.now,
        )
        world.timeline.note(self.name, "starts")
        world.timeline.after(_TICK_S, self._alive(self._forward))
        world.timeline.after(_SYNC_S, self._alive(self._sync))
        world.broker.connect(self)

    def _make_backoff(self, purpose: str) -> Backoff:
        draws = self._world.timeline.draws(f"{purpose} of {self.name} in life {self.life}")
        return Backoff(0.3, 3.0, random=draws)

    def die(self, lasts: float) -> None:
        """Lose all but the files, and start again after so many seconds."""
        if not self.connected:
            return
        self._world.timeline.note(self.name, "dies")
        self.connected = False
        self.life += 1
        self.spool.close()
        self._world.timeline.after(lasts, self._start)

    def close(self) -> None:
        """Close the spool."""
        if self.connected:
            self.spool.close()

    def _die_of(self, fault: Fault | None) -> None:
        """Die in the middle of what is done now, if a fault says so."""
        if fault is not None:
            self.die(fault.lasts)
            raise KilledError

    def _alive(self, action: Callable[[], None]) -> Callable[[], None]:
        """An action of this life, in which the gateway may be killed."""
        life = self.life

        def act() -> None:
            if life != self.life:
                return
            hang = self._world.faults.lasting(self.name, "hangs")
            if hang is not None:
                left = hang.at + hang.lasts - self._world.timeline.now / SECOND
                self._world.timeline.after(left + 0.001, act)
                return
            try:
                action()
            except KilledError:
                if life == self.life:
                    raise

        return act

    def _elapse(self, seconds: float) -> None:
        """Wait while all others go on; this gateway may be killed meanwhile."""
        life = self.life
        self._world.timeline.elapse(seconds)
        if life != self.life:
            raise KilledError

    # From the broker to the spool.

    def receive(self, name: str, topic: str, payload: bytes, *, retained: bool) -> None:
        """Take a message from the broker."""
        if not self._received and not self._committing:
            delay = self._latency.uniform(0.001, 0.2)
            self._world.timeline.after(delay, self._alive(self._commit))
        self._received.append((name, ReceivedMessage(topic, payload, 0, 1, retained, 1)))

    def _commit(self) -> None:
        if self._committing:
            return
        self._committing = True
        while self._received:
            batch, self._received = self._received[:_BATCH], self._received[_BATCH:]
            self._world.timeline.note(self.name, "takes " + " ".join(name for name, _ in batch))
            dying = self._world.faults.once(self.name, "dies before a commit")
            self._dying = dying
            lasting = self._world.faults.lasting(self.name, "cannot write its spool")
            self._set_failing(failing=bool(dying or lasting))
            self._commit_loop.process_or_split([message for _, message in batch])
            self._world.laws.check_spool(self)
        self._committing = False

    def _wait_to_commit(self, seconds: float) -> bool:
        """After a commit that failed."""
        self._world.timeline.note(self.name, f"fails to commit: {self._fault()}")
        self._die_of(self._dying)
        if self._asking:
            # A request of this gateway, which goes on after this returns, may be what frees the
            # spool. The batch is given up, as when the loop is stopped; nodes send it again.
            return True
        self._elapse(seconds)
        lasting = self._world.faults.lasting(self.name, "cannot write its spool")
        self._set_failing(failing=lasting is not None)
        return False

    def _fault(self) -> str:
        fault = self._commit_loop.fault or ""
        return "disk full" if "cannot be written" in fault else "spool full"

    def _set_failing(self, *, failing: bool) -> None:
        """Make commits fail, or work; a constraint fails in the middle of the transaction."""
        if failing != self._failing:
            with closing(sqlite3.connect(self.path, isolation_level=None)) as db:
                db.execute(_FAIL if failing else _WORK)
            self._failing = failing

    def acknowledge(self, received_messages: Sequence[ReceivedMessage]) -> None:
        """Drop the messages at the broker, which keeps none here."""

    def publish(self, publications: Iterable[tuple[str, bytes, bool]]) -> None:
        """Give acknowledgements to the broker; other clients get nothing here."""
        for topic, payload, _ in publications:
            if not topic.endswith(f"/{Stream.ACKS}"):
                continue
            node, _ = parse_node_topic(topic)
            # A commit that was to fail and had nothing to write ends here.
            self._die_of(self._dying or self._world.faults.once(self.name, "dies after a commit"))
            self._world.laws.check_acknowledgement(self, node, topic, payload)
            self._world.broker.acknowledge(node, payload)

    # From the spool to the cloud.

    def _forward(self) -> None:
        delay = self._latency.uniform(_TICK_S, 4 * _TICK_S)
        try:
            if self._forwarder.forward():
                delay = 0.001
            self._forwarder.compare()
        except (CloudError, SpoolError) as error:
            self._world.timeline.note(self.name, f"fails to forward: {_status(error)}")
            self._forwarder.note_failure(error)
            retry_after = error.retry_after if isinstance(error, CloudError) else None
            delay = self._backoff.failed(at_least=retry_after)
        self._world.timeline.after(delay, self._alive(self._forward))

    def _sync(self) -> None:
        try:
            self._subject_sync.sync()
        except (CloudError, SpoolError) as error:
            self._world.timeline.note(self.name, f"fails to synchronise: {_status(error)}")
        self._world.timeline.after(_SYNC_S, self._alive(self._sync))

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        """Carry a request to the cloud, and its answer back, as far as faults permit."""
        life = self.life
        self._asking += 1
        try:
            return self._carry(request)
        finally:
            if life == self.life:
                self._asking -= 1

    def _carry(self, request: httpx.Request) -> httpx.Response:
        world, faults = self._world, self._world.faults
        path, body = request.url.path, request.read()
        headers = [(key.lower(), value) for key, value in request.headers.raw]

        def ask() -> httpx.Response:
            return world.cloud.answer(self.name, path, headers, body)

        self._die_of(faults.once(self.name, "dies before a request"))
        self._elapse(self._latency.uniform(0.001, 0.08))
        if faults.lasting(self.name, "is cut off"):
            raise httpx.ConnectError("cut off")
        late = faults.once(self.name, "sends a request late")
        if late is not None:
            world.timeline.after(late.lasts, lambda: _ignore(ask))
            self._elapse(1.0)
            raise httpx.ReadTimeout("late")
        response = ask()
        again = faults.once(self.name, "repeats a request later")
        if again is not None:
            world.timeline.after(again.lasts, lambda: _ignore(ask))
        self._elapse(self._latency.uniform(0.001, 0.08))
        self._die_of(faults.once(self.name, "dies before it settles"))
        if faults.once(self.name, "loses an answer"):
            raise httpx.ReadError("answer lost")
        return response


def _ignore(ask: Callable[[], httpx.Response]) -> None:
    """Send a request whose answer no one waits for."""
    with suppress(httpx.HTTPError):
        ask()


def _status(error: Exception) -> str:
    """What failed, without texts that name files."""
    if isinstance(error, CloudError):
        return f"status {error.status}"
    return type(error).__name__
