"""The gateway as a process."""

from __future__ import annotations

import logging
import signal
from random import SystemRandom
from threading import Event
from time import monotonic, time_ns
from typing import TYPE_CHECKING, TypedDict

from eskin.identity import IdentityKind, RevocationFile, Trust, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.memory import settle
from eskin.messages.warmup import warm_up
from eskin.moment import SECOND
from eskin.privacy import open_vault
from gateway.acknowledger import Acknowledger
from gateway.answers import Answers
from gateway.assignments import Assignments
from gateway.backoff import Backoff
from gateway.certificates import HttpsCertificates
from gateway.cloud import HttpsCloud
from gateway.cloud_client import CloudClient
from gateway.commands import Commands
from gateway.condition import Condition
from gateway.confirmations import HttpsConfirmations
from gateway.counters import Counters
from gateway.courier import Courier
from gateway.deliveries import HttpsDeliveries
from gateway.discovery import Discovery
from gateway.dispatcher import Dispatcher
from gateway.forwarder import Forwarder
from gateway.health import Health
from gateway.inbox import Inbox
from gateway.intake import Intake
from gateway.keyring import Keyring
from gateway.monitor import Monitor
from gateway.mqtt import MqttBroker
from gateway.notices import HttpsNotices
from gateway.onlookers import Onlookers
from gateway.presence import Presence
from gateway.records import Records
from gateway.sealers import Sealers
from gateway.senders import Senders
from gateway.spool import Spool
from gateway.steward import Steward
from gateway.veiling import Veiling
from gateway.worker import Worker

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable
    from types import FrameType

    from gateway.settings import GatewaySettings

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
    settle()
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
        self.counters = Counters()
        self.inbox = Inbox(settings.broker.inbox_messages, most_bytes=settings.broker.inbox_bytes)
        self.spool = Spool(
            settings.spool.path,
            capacity=settings.spool.capacity_bytes,
            letters=settings.spool.dead_letters,
        )
        self.vault = open_vault(settings.keys, settings.vault)
        self.assignments = Assignments(self.vault)
        self.veiling = Veiling(self.assignments)
        root = identity.directory / ROOT_FILE
        self._trust = Trust.following(root)
        self._revocations = RevocationFile(
            self._trust, IdentityKind.NODE, settings.identity.revocations
        )
        self._presence = Presence(settings.nodes.silence_s)
        self._presence.restore(self.spool, monotonic())
        self.commands = Commands(settings.commands.resend_s)
        self.broker = self._make_broker()
        self._onlookers = Onlookers()
        self.worker = self._make_worker()
        reach: _Reach = {
            "headers": Condition(self.spool, self._presence).headers,
            "context": client_context(root, identity),
            "timeout_s": settings.cloud.timeout_s,
        }
        self._client = CloudClient(settings.cloud.url, **reach)
        self.certificates = HttpsCertificates(self._client, self.spool)
        self.forwarder = self._make_forwarder()
        self.courier = self._make_courier(HttpsDeliveries(settings.cloud.url, **reach))
        self.steward = Steward(
            self.vault,
            self.assignments,
            veiling=self.veiling,
            notices=HttpsNotices(self._client),
            certificates=self.certificates,
            share=settings.keys.share,
            backoff=Backoff(
                settings.cloud.retry_s, settings.cloud.retry_most_s, random=SystemRandom()
            ),
        )
        self.counters.gauge(
            "erasures_pending",
            "erasures that the cloud has not confirmed",
            lambda: self.steward.pending,
        )
        self.counters.gauge(
            "confirmed_missing",
            "messages that the cloud had confirmed and no longer has",
            lambda: self.forwarder.missing,
        )
        self.monitor = self._make_monitor()

    def _make_broker(self) -> MqttBroker:
        return MqttBroker(
            self._settings.broker,
            name=self.name,
            context=self.keyring.context,
            inbox=self.inbox,
            backoff=Backoff(0.2, 10.0, random=SystemRandom()),
        )

    def _make_worker(self) -> Worker:
        senders = Senders(
            self.spool,
            self._trust,
            revocations=self._revocations,
            site=self.keyring.gateway.site,
        )
        intake = Intake(
            opener=self.keyring.make_opener(senders.find),
            senders=senders,
            records=Records(self.spool),
            veiling=self.veiling,
        )
        sealers = Sealers(self.keyring.answering)
        answers = Answers(
            broker=self.broker,
            acknowledger=Acknowledger(sealers),
            senders=senders,
            presence=self._presence,
            counters=self.counters,
            onlookers=self._onlookers,
            discovery=self._make_discovery(senders),
            senml=self._settings.public.senml,
        )
        dispatcher = Dispatcher(
            self.commands,
            broker=self.broker,
            sealers=sealers,
            senders=senders,
            spool=self.spool,
            counters=self.counters,
        )
        return Worker(
            self._settings.spool,
            inbox=self.inbox,
            intake=intake,
            spool=self.spool,
            answers=answers,
            dispatcher=dispatcher,
            counters=self.counters,
        )

    def _make_discovery(self, senders: Senders) -> Discovery | None:
        public = self._settings.public
        if not public.homeassistant:
            return None
        return Discovery(
            public.homeassistant_prefix,
            forget_ns=round(public.homeassistant_forget_days * 86_400 * SECOND),
            spool=self.spool,
            senders=senders,
            now=time_ns,
        )

    def _make_forwarder(self) -> Forwarder:
        cloud = self._settings.cloud
        return Forwarder(
            cloud,
            spool=self.spool,
            cloud=HttpsCloud(self._client, self._onlookers),
            certificates=self.certificates,
            backoff=Backoff(cloud.retry_s, cloud.retry_most_s, random=SystemRandom()),
            counters=self.counters,
            confirmations=HttpsConfirmations(self._client, self.certificates),
        )

    def _make_courier(self, deliveries: HttpsDeliveries) -> Courier:
        cloud = self._settings.cloud
        return Courier(
            self.commands,
            deliveries=deliveries,
            wait_s=self._settings.commands.wait_s,
            backoff=Backoff(cloud.retry_s, cloud.retry_most_s, random=SystemRandom()),
            counters=self.counters,
        )

    def _make_monitor(self) -> Monitor:
        health = Health(
            broker=self.broker,
            inbox=self.inbox,
            worker=self.worker,
            spool=self.spool,
            forwarder=self.forwarder,
            courier=self.courier,
            presence=self._presence,
            revocations=self._revocations,
            steward=self.steward,
        )
        health.export(self.counters)
        return Monitor(self._settings.http, health=health, counters=self.counters)

    def start(self) -> None:
        """Start all threads."""
        self.keyring.start()
        self.monitor.start()
        self.forwarder.start()
        self.courier.start()
        self.steward.start()
        self.worker.start()
        self.broker.start()

    def stop(self) -> None:
        """Take nothing more, commit and answer what came, forward what the cloud takes, close."""
        self.broker.refuse()
        self.courier.stop()
        self.steward.stop()
        self.worker.stop()
        self.broker.stop()
        self.forwarder.stop()
        self.monitor.stop()
        self._client.close()
        self.left = self.spool.statistics.messages
        self.spool.close()
        self.keyring.stop()
