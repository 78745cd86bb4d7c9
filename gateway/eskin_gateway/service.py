"""The gateway as a process."""

from __future__ import annotations

import logging
import signal
from random import SystemRandom
from threading import Event
from time import monotonic, time_ns
from typing import TYPE_CHECKING, TypedDict

from eskin.identity import ChainVerifier, IdentityKind, RevocationFile, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.privacy import open_keystore
from eskin.runtime.memory import freeze_gc
from eskin.wire.messages.warm_up import warm_up
from eskin.wire.timestamp import SECOND
from eskin_gateway.backoff import Backoff
from eskin_gateway.commands.pending import PendingCommands
from eskin_gateway.commands.poller import CommandPoller
from eskin_gateway.commands.publisher import CommandPublisher
from eskin_gateway.forward.forwarder import Forwarder
from eskin_gateway.forward.status_report import StatusReport
from eskin_gateway.ingest.acknowledger import Acknowledger
from eskin_gateway.ingest.biometric import BiometricEncryptor
from eskin_gateway.ingest.commit_loop import CommitLoop
from eskin_gateway.ingest.post_commit import PostCommit
from eskin_gateway.ingest.validator import Validator
from eskin_gateway.metrics import Metrics
from eskin_gateway.mqtt.mqtt_transport import MqttTransport
from eskin_gateway.mqtt.receive_queue import ReceiveQueue
from eskin_gateway.ops.health import Health
from eskin_gateway.ops.health_server import HealthServer
from eskin_gateway.ops.keyring import Keyring
from eskin_gateway.ops.subject_sync import SubjectSync
from eskin_gateway.publish.discovery import Discovery
from eskin_gateway.publish.presence import Presence
from eskin_gateway.spool.node_certificates import NodeCertificates
from eskin_gateway.spool.node_states import NodeStates
from eskin_gateway.spool.sealer_cache import SealerCache
from eskin_gateway.spool.spool import Spool
from eskin_gateway.spool.subject_assignments import SubjectAssignments
from eskin_gateway.upstream.certificates_client import HttpsCertificates
from eskin_gateway.upstream.cloud_client import CloudClient
from eskin_gateway.upstream.commands_client import HttpsDeliveries
from eskin_gateway.upstream.confirmations_client import HttpsConfirmations
from eskin_gateway.upstream.ingest_client import HttpsCloud
from eskin_gateway.upstream.subjects_client import HttpsNotices
from eskin_gateway.upstream.viewers import Viewers

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable
    from types import FrameType

    from eskin_gateway.settings import GatewaySettings

log = logging.getLogger(__name__)


def run(settings: GatewaySettings) -> None:
    """Run until SIGTERM or SIGINT, then drain and close.

    Raises:
        EskinError: It cannot start: identity, spool or address cannot be used.
    """
    stop = Event()

    def end(number: int, frame: FrameType | None) -> None:
        del frame
        log.info("ending: signal=%s", signal.Signals(number).name)
        stop.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, end)
    gateway = Gateway(settings)
    warm_up()
    gateway.start()
    freeze_gc()
    log.info(
        "ready: gateway=%s broker=%s:%d cloud=%s health=http://%s:%d/healthz",
        gateway.name,
        settings.broker.host,
        settings.broker.port,
        settings.cloud.url,
        settings.http.host,
        gateway.monitor.port,
    )
    stop.wait()
    gateway.stop()
    log.info("ended: %d messages wait in the spool for the next start", gateway.left)


class _Reach(TypedDict):
    """How the cloud is reached, for what is sent and for what is fetched."""

    headers: Callable[[], dict[str, str]]
    context: ssl.SSLContext
    timeout_s: float


class Gateway:
    """All parts of one gateway, put together.

    Raises:
        EskinError: A part cannot be made.
    """

    def __init__(self, settings: GatewaySettings) -> None:
        self.keyring = Keyring(settings.identity)
        identity = self.keyring.gateway
        self.name = identity.name
        self.left = 0
        self._settings = settings
        self.metrics = Metrics()
        self.receive_queue = ReceiveQueue(
            settings.broker.receive_queue_messages, most_bytes=settings.broker.receive_queue_bytes
        )
        self.spool = Spool(
            settings.spool.path,
            capacity=settings.spool.capacity_bytes,
            letters=settings.spool.dead_letters,
        )
        self.keystore = open_keystore(settings.keys, settings.keystore)
        self.assignments = SubjectAssignments(self.keystore)
        self.encryptor = BiometricEncryptor(self.assignments)
        root = identity.directory / ROOT_FILE
        self._trust = ChainVerifier.following(root)
        self._revocations = RevocationFile(
            self._trust, IdentityKind.NODE, settings.identity.revocations
        )
        self._presence = Presence(settings.nodes.silence_s)
        self._presence.restore(self.spool, monotonic())
        self.commands = PendingCommands(settings.commands.resend_s)
        self.broker = self._make_broker()
        self._viewers = Viewers()
        self.worker = self._make_worker()
        reach: _Reach = {
            "headers": StatusReport(self.spool, self._presence).headers,
            "context": client_context(root, identity),
            "timeout_s": settings.cloud.timeout_s,
        }
        self._client = CloudClient(settings.cloud.url, **reach)
        self.certificates = HttpsCertificates(self._client, self.spool)
        self.forwarder = self._make_forwarder()
        self.command_poller = self._make_command_poller(
            HttpsDeliveries(settings.cloud.url, **reach)
        )
        self.subject_sync = SubjectSync(
            self.keystore,
            self.assignments,
            encryptor=self.encryptor,
            subjects_client=HttpsNotices(self._client),
            certificates=self.certificates,
            share=settings.keys.share,
            backoff=Backoff(
                settings.cloud.retry_s, settings.cloud.retry_most_s, random=SystemRandom()
            ),
        )
        self.metrics.gauge(
            "erasures_pending",
            "erasures that the cloud has not confirmed",
            lambda: self.subject_sync.pending,
        )
        self.metrics.gauge(
            "confirmed_missing",
            "messages that the cloud had confirmed and no longer has",
            lambda: self.forwarder.missing,
        )
        self.monitor = self._make_monitor()

    def _make_broker(self) -> MqttTransport:
        return MqttTransport(
            self._settings.broker,
            name=self.name,
            context=self.keyring.context,
            receive_queue=self.receive_queue,
            backoff=Backoff(0.2, 10.0, random=SystemRandom()),
        )

    def _make_worker(self) -> CommitLoop:
        node_certificates = NodeCertificates(
            self.spool,
            self._trust,
            revocations=self._revocations,
            site=self.keyring.gateway.site,
        )
        validator = Validator(
            opener=self.keyring.make_opener(node_certificates.find),
            node_certificates=node_certificates,
            records=NodeStates(self.spool),
            encryptor=self.encryptor,
        )
        sealer_cache = SealerCache(self.keyring.answering)
        answers = PostCommit(
            broker=self.broker,
            acknowledger=Acknowledger(sealer_cache),
            node_certificates=node_certificates,
            presence=self._presence,
            metrics=self.metrics,
            viewers=self._viewers,
            discovery=self._make_discovery(node_certificates),
            senml=self._settings.public.senml,
        )
        command_publisher = CommandPublisher(
            self.commands,
            broker=self.broker,
            sealer_cache=sealer_cache,
            node_certificates=node_certificates,
            spool=self.spool,
            metrics=self.metrics,
        )
        return CommitLoop(
            self._settings.spool,
            receive_queue=self.receive_queue,
            validator=validator,
            spool=self.spool,
            answers=answers,
            command_publisher=command_publisher,
            metrics=self.metrics,
        )

    def _make_discovery(self, node_certificates: NodeCertificates) -> Discovery | None:
        public = self._settings.public
        if not public.homeassistant:
            return None
        return Discovery(
            public.homeassistant_prefix,
            forget_ns=round(public.homeassistant_forget_days * 86_400 * SECOND),
            spool=self.spool,
            node_certificates=node_certificates,
            now=time_ns,
        )

    def _make_forwarder(self) -> Forwarder:
        cloud = self._settings.cloud
        return Forwarder(
            cloud,
            spool=self.spool,
            cloud=HttpsCloud(self._client, self._viewers),
            certificates=self.certificates,
            backoff=Backoff(cloud.retry_s, cloud.retry_most_s, random=SystemRandom()),
            metrics=self.metrics,
            confirmations=HttpsConfirmations(self._client, self.certificates),
        )

    def _make_command_poller(self, commands_client: HttpsDeliveries) -> CommandPoller:
        cloud = self._settings.cloud
        return CommandPoller(
            self.commands,
            commands_client=commands_client,
            wait_s=self._settings.commands.wait_s,
            backoff=Backoff(cloud.retry_s, cloud.retry_most_s, random=SystemRandom()),
            metrics=self.metrics,
        )

    def _make_monitor(self) -> HealthServer:
        health = Health(
            broker=self.broker,
            receive_queue=self.receive_queue,
            worker=self.worker,
            spool=self.spool,
            forwarder=self.forwarder,
            command_poller=self.command_poller,
            presence=self._presence,
            revocations=self._revocations,
            subject_sync=self.subject_sync,
        )
        health.export(self.metrics)
        return HealthServer(self._settings.http, health=health, metrics=self.metrics)

    def start(self) -> None:
        """Start all threads."""
        self.keyring.start()
        self.monitor.start()
        self.forwarder.start()
        self.command_poller.start()
        self.subject_sync.start()
        self.worker.start()
        self.broker.start()

    def stop(self) -> None:
        """Take nothing more, commit and answer what came, forward what the cloud takes, close."""
        self.broker.refuse()
        self.command_poller.stop()
        self.subject_sync.stop()
        self.worker.stop()
        self.broker.stop()
        self.forwarder.stop()
        self.monitor.stop()
        self._client.close()
        self.left = self.spool.statistics.messages
        self.spool.close()
        self.keyring.stop()
