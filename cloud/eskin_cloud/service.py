"""The cloud as a process: two listeners over one state."""

from __future__ import annotations

import asyncio
import logging
import signal
import time
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eskin.errors import IdentityError, LockedError, SettingsError, StoreError
from eskin.identity import ChainVerifier, Identity, server_context
from eskin.identity.identity import ROOT_FILE
from eskin.privacy import open_keystore
from eskin.runtime.files.lock import LockFile
from eskin.runtime.http_server.listener import Listener, bind
from eskin.runtime.http_server.protocol import LOCALHOST, HttpLimits
from eskin.runtime.http_server.rate_limit import RateLimit
from eskin.runtime.memory import freeze_gc
from eskin.wire.timestamp import SECOND
from eskin_cloud.alarms.evaluator import Evaluator
from eskin_cloud.api.live import MOST_MESSAGE_BYTES
from eskin_cloud.app import gateway_application, people_application
from eskin_cloud.app_state import AppState
from eskin_cloud.commands.command_queue import Notifier
from eskin_cloud.ingest.gateway_contacts import GatewayContacts
from eskin_cloud.ingest.gateway_trust import GatewayTrust
from eskin_cloud.ingest.upload_budget import UploadBudget
from eskin_cloud.jobs.alarm_delivery import deliver_alarms
from eskin_cloud.jobs.compaction import compact
from eskin_cloud.jobs.erasure import apply_erasures
from eskin_cloud.jobs.heap_trim import trim_heap, use_one_allocator
from eskin_cloud.jobs.integrity import check_integrity
from eskin_cloud.jobs.missing_messages import find_missing_messages
from eskin_cloud.jobs.monitors import evaluate_monitors
from eskin_cloud.jobs.overview_tiles import build_rollup
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.jobs.pg_listener import listen
from eskin_cloud.jobs.retention import apply_retention
from eskin_cloud.jobs.silence import watch_silence
from eskin_cloud.live import Feed, LiveContacts
from eskin_cloud.metrics import Metrics
from eskin_cloud.privacy.key_access import KeyAccess
from eskin_cloud.store import Store
from eskin_cloud.store.stuck_writer import end_stuck_writer
from eskin_cloud.warm_up import warm_up

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Coroutine, Iterator

    from eskin_cloud.settings import CloudSettings

log = logging.getLogger(__name__)

DASHBOARD = Path(__file__).with_name("dashboard")


def run(settings: CloudSettings) -> None:
    """Serve until SIGTERM or SIGINT.

    Raises:
        SettingsError: An address or a certificate cannot be used.
        IdentityError: The server's identity cannot be read.
        StoreError: The store cannot be opened, or another cloud has it.
    """
    use_one_allocator()
    with ExitStack() as stack:
        place = settings.store.place
        if isinstance(place, Path):
            stack.enter_context(only_one(place))
        store = stack.enter_context(
            Store(place, readers=settings.store.readers, queue=settings.store.queue)
        )
        cloud = make_cloud(settings, store, clock=time.time_ns)
        warm_up()
        asyncio.run(_serve(cloud))
    log.info("stopped")


def make_cloud(
    settings: CloudSettings,
    store: Store,
    *,
    clock: Callable[[], int],
    dashboard: Path = DASHBOARD,
) -> AppState:
    """Put the shared state together.

    Raises:
        IdentityError: The server's identity cannot be read.
        PrivacyError: The key store cannot be used.
    """
    own, live = settings.gateways, settings.live
    feed = Feed(store, recent=live.recent, recent_bytes=live.recent_bytes)
    notifier = Notifier()
    trust = ChainVerifier.following(own.identity / ROOT_FILE)
    clock_error = round(settings.nodes.clock_error_s * SECOND)
    metrics = Metrics(store, feed, notifier, clock_error=clock_error)
    keys = settings.keys
    keystore = None if keys.directory is None else open_keystore(keys, keys.directory)
    return AppState(
        settings=settings,
        store=store,
        feed=feed,
        contacts=LiveContacts(feed),
        notifier=notifier,
        gateway_trust=GatewayTrust(
            trust, gateways=own.revocations, nodes=settings.nodes.revocations
        ),
        gateway_contacts=GatewayContacts(store, clock),
        uploads=UploadBudget(own.uploads_bytes),
        metrics=metrics,
        sign_ins=RateLimit.per_minute(settings.limits.refusals_per_min),
        evaluator=Evaluator(store, silence=round(settings.nodes.silence_s * SECOND), clock=clock),
        key_access=KeyAccess(keystore),
        clock=clock,
        dashboard=dashboard,
    )


def _listeners(cloud: AppState) -> tuple[Listener, Listener]:
    """For people and for gateways."""
    people, gateways = cloud.settings.people, cloud.settings.gateways
    limits = cloud.settings.limits
    bounds = HttpLimits(connections=limits.connections, of_one=limits.connections_of_one)
    context = None
    if people.identity is not None:
        context = _server_context("people.identity", people.identity, client_certificates=False)
    # A browser checks the name by TLS. Without it, DNS may lead any page here.
    plain = LOCALHOST | {people.host.lower(), *people.names}
    return (
        Listener(
            people_application(cloud),
            bind("people", people.host, people.port),
            context=context,
            bounds=replace(
                bounds,
                body_bytes=limits.body_bytes,
                message_bytes=MOST_MESSAGE_BYTES,
                hosts=plain if context is None else None,
                proxies=tuple(people.proxies),
                forwarded=people.forwarded,
            ),
        ),
        Listener(
            gateway_application(cloud),
            bind("gateways", gateways.host, gateways.port),
            context=_server_context(
                "gateways.identity", gateways.identity, client_certificates=True
            ),
            bounds=bounds,
        ),
    )


def _server_context(setting: str, folder: Path, *, client_certificates: bool) -> ssl.SSLContext:
    """For TLS; follows renewals of the certificate, and of the roots.

    Raises:
        SettingsError: The identity cannot be used.
    """
    try:
        if client_certificates:
            Identity.load(folder)
        return server_context(folder, client_certificates=client_certificates)
    except IdentityError as error:
        raise SettingsError(setting, str(error)) from error


async def _serve(cloud: AppState) -> None:
    listeners = _listeners(cloud)
    stopping = asyncio.Event()
    jobs = _jobs(cloud, stopping)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stopping.set)
    async with asyncio.TaskGroup() as group:
        for listener, name in zip(listeners, ("people", "gateways"), strict=True):
            group.create_task(listener.serve(), name=name)
        listening = None
        if not isinstance(cloud.store.location, Path):
            listening = group.create_task(listen(cloud, cloud.store.location, stopping))
        for job in jobs:
            group.create_task(job)
        for listener in listeners:
            await listener.ready.wait()
        freeze_gc()
        log.info(
            "ready: people=%s gateways=%s store=%s",
            listeners[0].url,
            listeners[1].url,
            cloud.store,
        )
        await stopping.wait()
        cloud.feed.close()
        cloud.notifier.close()
        if listening is not None:
            listening.cancel()
        for listener in listeners:
            listener.should_exit = True
    await cloud.gateway_contacts.written()


def _jobs(cloud: AppState, stopping: asyncio.Event) -> list[Coroutine[Any, Any, None]]:
    """What runs in the background beside the listeners."""
    end_stuck = partial(asyncio.to_thread, end_stuck_writer, cloud.store)
    return [
        run_periodically("stuck writer", end_stuck, cloud=cloud, stopping=stopping, every_s=1.0),
        watch_silence(cloud, stopping),
        apply_erasures(cloud, stopping),
        find_missing_messages(cloud, stopping),
        apply_retention(cloud, stopping),
        build_rollup(cloud, stopping),
        trim_heap(cloud, stopping),
        compact(cloud, stopping),
        check_integrity(cloud, stopping),
        evaluate_monitors(cloud, stopping),
        *deliver_alarms(cloud, stopping),
    ]


@contextmanager
def only_one(path: Path) -> Iterator[None]:
    """Hold a file for this process: SQLite has no way to notify others of what is new.

    Raises:
        StoreError: Another process has it.
    """
    try:
        owner = LockFile(path)
    except LockedError as error:
        raise StoreError(f"{path}: another cloud runs on this store; stop it first") from error
    except OSError as error:
        raise StoreError(f"{path}: the store cannot be opened: {error}") from error
    with owner:
        yield
