"""The gateway as a process."""

from __future__ import annotations

import logging
from functools import partial
from random import SystemRandom
from threading import Event
from time import monotonic, time_ns
from typing import TYPE_CHECKING

from eskin.identity import ChainVerifier, IdentityKind, RevocationFile, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.privacy import open_keystore
from eskin.runtime.memory import freeze_gc
from eskin.runtime.stop_signals import stop_on_signals
from eskin.runtime.supervised import Backoff
from eskin.wire.frames.warm_up import warm_up
from eskin.wire.timestamp import SECOND
from eskin_gateway.commands.poller import CommandPoller, CommandsClient
from eskin_gateway.commands.publisher import CommandPublisher, PendingCommands
from eskin_gateway.forward.forwarder import Forwarder
from eskin_gateway.forward.status_report import StatusReport
from eskin_gateway.ingest.biometric import BiometricEncryptor
from eskin_gateway.ingest.commit_loop import CommitLoop, PostCommit
from eskin_gateway.ingest.missing_layouts import MissingLayouts
from eskin_gateway.ingest.validator import Validator
from eskin_gateway.metrics import Metrics
from eskin_gateway.mqtt.mqtt_transport import MqttTransport
from eskin_gateway.mqtt.receive_queue import ReceiveQueue
from eskin_gateway.mqtt.sealer_cache import SealerCache
from eskin_gateway.ops.health import Health
from eskin_gateway.ops.health_server import HealthServer
from eskin_gateway.ops.keyring import Keyring
from eskin_gateway.ops.subject_sync import SubjectSync
from eskin_gateway.publish.alarms import AlarmPublisher
from eskin_gateway.publish.homeassistant import Discovery
from eskin_gateway.publish.presence import Presence
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

if TYPE_CHECKING:
    from eskin_gateway.settings import GatewaySettings

log = logging.getLogger(__name__)


def run(settings: GatewaySettings) -> None:
    """Run until SIGTERM or SIGINT, then drain and close.

    Raises:
        EskinError: Identity, spool or address cannot be used.
    """
    stop = Event()
    stop_on_signals(stop)
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
        gateway.health_server.port,
    )
    stop.wait()
    left = gateway.stop()
    log.info("ended: messages_left=%d", left)


class Gateway:
    """All parts of one gateway.

    Raises:
        EskinError: A part cannot be made.
    """

    def __init__(self, settings: GatewaySettings) -> None:
        self._settings = settings
        self.keyring = Keyring(settings.identity)
        identity = self.keyring.gateway
        self.name = identity.name
        self.metrics = Metrics()
        self.receive_queue = ReceiveQueue(
            settings.broker.receive_queue_messages, most_bytes=settings.broker.receive_queue_bytes
        )
        self.spool = Spool(
            settings.spool.path,
            capacity=settings.spool.capacity_bytes,
            max_dead_letters=settings.spool.dead_letters,
        )
        self.keystore = open_keystore(settings.keys, settings.keystore)
        self.assignments = SubjectAssignments(self.keystore)
        self.encryptor = BiometricEncryptor(self.assignments)
        root = identity.directory / ROOT_FILE
        self._verifier = ChainVerifier.following(root)
        self._revocations = RevocationFile(
            self._verifier, IdentityKind.NODE, settings.identity.revocations
        )
        self._presence = Presence(settings.nodes.silence_s)
        self._presence.restore(self.spool, monotonic())
        self.commands = PendingCommands(settings.commands.resend_s)
        public = settings.public
        self.alarms = AlarmPublisher(public.homeassistant_prefix if public.homeassistant else None)
        self.broker = MqttTransport(
            settings.broker,
            name=self.name,
            context=self.keyring.context,
            receive_queue=self.receive_queue,
            on_alarm=self.alarms.confirm,
            backoff=Backoff(0.2, 10.0, random=SystemRandom()),
        )
        self.commit_loop = self._make_commit_loop()
        cloud_client = partial(
            CloudClient,
            [settings.cloud.url, *settings.cloud.fallbacks],
            headers=StatusReport(self.spool, self._presence).headers,
            context=client_context(root, identity),
            timeout_s=settings.cloud.timeout_s,
        )
        self._client = cloud_client()
        self.certificates_client = CertificatesClient(self._client, self.spool)
        self.subject_sync = SubjectSync(
            self.keystore,
            self.assignments,
            encryptor=self.encryptor,
            subjects_client=SubjectsClient(self._client),
            certificates_client=self.certificates_client,
            share=settings.keys.share,
            backoff=self._make_cloud_backoff(),
        )
        self.forwarder = Forwarder(
            settings.cloud,
            spool=self.spool,
            ingest_client=IngestClient(self._client),
            certificates_client=self.certificates_client,
            descriptions_client=DescriptionsClient(self._client, self.spool),
            backoff=self._make_cloud_backoff(),
            metrics=self.metrics,
            confirmations_client=ConfirmationsClient(self._client, self.certificates_client),
            confirm_erasures=self.subject_sync.confirm_erasures,
        )
        self.command_poller = CommandPoller(
            self.commands,
            self.alarms,
            commands_client=CommandsClient(cloud_client(abortable=True)),
            wait_s=settings.commands.wait_s,
            backoff=self._make_cloud_backoff(),
            metrics=self.metrics,
        )
        health = Health(
            broker=self.broker,
            receive_queue=self.receive_queue,
            commit_loop=self.commit_loop,
            spool=self.spool,
            forwarder=self.forwarder,
            command_poller=self.command_poller,
            presence=self._presence,
            revocations=self._revocations,
            subject_sync=self.subject_sync,
        )
        health.export(self.metrics)
        self.health_server = HealthServer(settings.http, health=health, metrics=self.metrics)

    def _make_cloud_backoff(self) -> Backoff:
        cloud = self._settings.cloud
        return Backoff(cloud.retry_s, cloud.retry_max_s, random=SystemRandom())

    def _make_commit_loop(self) -> CommitLoop:
        node_certificates = NodeCertificates(
            self.spool,
            self._verifier,
            revocations=self._revocations,
            site=self.keyring.gateway.site,
        )
        sealer_cache = SealerCache(self.keyring.find_site)
        descriptions = Descriptions(self.spool)
        return CommitLoop(
            self._settings.spool,
            receive_queue=self.receive_queue,
            validator=Validator(
                opener=self.keyring.make_opener(node_certificates.find),
                node_certificates=node_certificates,
                node_states=NodeStates(self.spool),
                descriptions=descriptions,
                missing_layouts=MissingLayouts(self._settings.nodes.layout_wait_s),
                encryptor=self.encryptor,
            ),
            spool=self.spool,
            post_commit=PostCommit(
                broker=self.broker,
                sealer_cache=sealer_cache,
                node_certificates=node_certificates,
                presence=self._presence,
                alarms=self.alarms,
                descriptions=descriptions,
                metrics=self.metrics,
                discovery=self._make_discovery(node_certificates, descriptions),
                senml=self._settings.public.senml,
            ),
            command_publisher=CommandPublisher(
                self.commands,
                broker=self.broker,
                sealer_cache=sealer_cache,
                node_certificates=node_certificates,
                metrics=self.metrics,
            ),
            metrics=self.metrics,
        )

    def _make_discovery(
        self, node_certificates: NodeCertificates, descriptions: Descriptions
    ) -> Discovery | None:
        public = self._settings.public
        if not public.homeassistant:
            return None
        return Discovery(
            public.homeassistant_prefix,
            expire_ns=round(public.homeassistant_expire_days * 86_400 * SECOND),
            spool=self.spool,
            node_certificates=node_certificates,
            descriptions=descriptions,
            now=time_ns,
        )

    def start(self) -> None:
        """Start all threads."""
        self.keyring.start()
        self.health_server.start()
        self.forwarder.start()
        self.command_poller.start()
        self.subject_sync.start()
        self.commit_loop.start()
        self.broker.start()

    def stop(self) -> int:
        """Drain and close; return how many messages are left in the spool."""
        self.broker.pause()
        self.command_poller.stop()
        self.subject_sync.stop()
        self.commit_loop.stop()
        self.broker.stop()
        self.forwarder.stop()
        self.health_server.stop()
        self._client.close()
        left = self.spool.statistics.messages
        self.spool.close()
        self.keyring.stop()
        return left
