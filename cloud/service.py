"""The cloud as a process: two listeners over one state."""

from __future__ import annotations

import asyncio
import logging
import signal
import time
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from cloud.allocator import use_one_allocator
from cloud.application import gateway_application, people_application
from cloud.certificate import Certificate
from cloud.commands import Board
from cloud.ingest.gatekeeper import Gatekeeper
from cloud.ingest.uploads import Uploads
from cloud.live import Feed, Onlookers
from cloud.live.relay import relay
from cloud.metrics import Metrics
from cloud.missing import look_for_missing
from cloud.packing import keep_packed
from cloud.privacy.erasures import hear
from cloud.privacy.keyholder import Keyholder
from cloud.pyramid.keeping import keep_built
from cloud.reclaim import reclaim
from cloud.retention import retain
from cloud.state import Cloud
from cloud.store import Store
from cloud.warmup import warm_up
from cloud.watch import watch
from cloud.wholeness import keep_whole
from eskin.errors import IdentityError, LockedError, SettingsError, StoreError
from eskin.identity import Identity, Trust, server_context
from eskin.identity.identity import ROOT_FILE
from eskin.limiting import RateLimit
from eskin.listener import Listener, bind
from eskin.listening import LOCALHOST, Bounds
from eskin.lockfile import LockFile
from eskin.memory import settle
from eskin.moment import SECOND
from eskin.privacy import open_vault

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Iterator

    from cloud.settings import CloudSettings

log = logging.getLogger(__name__)

DASHBOARD = Path(__file__).with_name("dashboard") / "dist"


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
) -> Cloud:
    """Put the shared state together.

    Raises:
        IdentityError: The server's identity cannot be read.
        PrivacyError: The key store cannot be used.
    """
    own = settings.gateways
    feed, board = _make_feed(settings, store), Board()
    trust = Trust.following(own.identity / ROOT_FILE)
    clock_error = round(settings.nodes.clock_error_s * SECOND)
    metrics = Metrics(store, feed, board, clock_error=clock_error)
    keys = settings.keys
    vault = None if keys.directory is None else open_vault(keys, keys.directory)
    return Cloud(
        settings=settings,
        store=store,
        feed=feed,
        onlookers=_make_onlookers(settings),
        board=board,
        gatekeeper=Gatekeeper(trust, gateways=own.revocations, nodes=settings.nodes.revocations),
        uploads=Uploads(own.uploads_bytes),
        metrics=metrics,
        sign_ins=RateLimit.per_minute(settings.limits.refusals_per_min),
        keyholder=Keyholder(vault),
        clock=clock,
        dashboard=dashboard,
    )


def _make_feed(settings: CloudSettings, store: Store) -> Feed:
    live = settings.live
    return Feed(store, recent=live.recent, recent_bytes=live.recent_bytes)


def _make_onlookers(settings: CloudSettings) -> Onlookers:
    live = settings.live
    return Onlookers(most=live.watched_nodes, lasting=live.watched_s)


def _listeners(cloud: Cloud, outer: Certificate | None) -> tuple[Listener, Listener]:
    """For people and for gateways."""
    people, gateways = cloud.settings.people, cloud.settings.gateways
    limits = cloud.settings.limits
    bounds = Bounds(connections=limits.connections, of_one=limits.connections_of_one)
    # A browser checks the name by TLS. Without it, DNS may lead any page here.
    plain = LOCALHOST | {people.host.lower(), *people.names}
    return (
        Listener(
            people_application(cloud),
            bind("people", people.host, people.port),
            context=None if outer is None else outer.context,
            bounds=replace(
                bounds,
                body_bytes=limits.body_bytes,
                hosts=plain if outer is None else None,
                proxies=tuple(people.proxies),
                forwarded=people.forwarded,
            ),
        ),
        Listener(
            gateway_application(cloud),
            bind("gateways", gateways.host, gateways.port),
            context=_gateways_context(gateways.identity),
            bounds=bounds,
        ),
    )


def _gateways_context(folder: Path) -> ssl.SSLContext:
    """For TLS with gateways, which show a certificate; follows renewals of its own, and roots.

    Raises:
        SettingsError: The identity cannot be used.
    """
    try:
        return server_context(Identity.load(folder), client_certificates=True)
    except IdentityError as error:
        raise SettingsError("gateways.identity", str(error)) from error


async def _serve(cloud: Cloud) -> None:
    people = cloud.settings.people
    outer = None if people.identity is None else Certificate("people.identity", people.identity)
    listeners = _listeners(cloud, outer)
    stopping = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stopping.set)
    certificates = [] if outer is None else [outer]
    async with asyncio.TaskGroup() as group:
        for listener, name in zip(listeners, ("people", "gateways"), strict=True):
            group.create_task(listener.serve(), name=name)
        listening = None
        if not isinstance(cloud.store.place, Path):
            listening = group.create_task(relay(cloud, cloud.store.place), name="relay")
        group.create_task(watch(cloud, certificates, stopping), name="watch")
        group.create_task(hear(cloud, stopping), name="erasures")
        group.create_task(look_for_missing(cloud, stopping), name="missing")
        group.create_task(retain(cloud, stopping), name="retention")
        group.create_task(keep_built(cloud, stopping), name="pyramid")
        group.create_task(reclaim(cloud, stopping), name="memory")
        group.create_task(keep_packed(cloud, stopping), name="packing")
        group.create_task(keep_whole(cloud, stopping), name="wholeness")
        for listener in listeners:
            await listener.ready.wait()
        settle()
        log.info(
            "ready: people=%s gateways=%s store=%s",
            listeners[0].url,
            listeners[1].url,
            cloud.store,
        )
        await stopping.wait()
        cloud.feed.close()
        cloud.board.close()
        if listening is not None:
            listening.cancel()
        for listener in listeners:
            listener.should_exit = True


@contextmanager
def only_one(path: Path) -> Iterator[None]:
    """Hold a file for this process: SQLite has no way to tell others what is new.

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
