"""Running the demo: start everything with progress, watch it, end it cleanly."""

from __future__ import annotations

import logging
import signal
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING, Final

from eskin_cloud.access import Scope, create_login_code, create_token
from eskin_cloud.store import Store
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from eskin.demo.access import write_access
from eskin.demo.identities import NEEDED, prepare_identities, renew_identities
from eskin.demo.layout import DemoFolder
from eskin.demo.ports import LOOPBACK, free_ports, require_free
from eskin.demo.settings_files import PROFILES, Ports, node_profiles
from eskin.demo.stack import Stack
from eskin.errors import IdentityError, LockedError, SettingsError
from eskin.mosquitto import BrokerPorts, find_mosquitto
from eskin.runtime.files.lock import LockFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from types import FrameType

    from rich.console import Console

log = logging.getLogger(__name__)

_WATCH_S: Final = 0.2
_RENEW_S: Final = 2.0
TOKEN_LIFETIME: Final = timedelta(days=30)
LOGIN_LIFETIME: Final = timedelta(minutes=15)


@dataclass(frozen=True, slots=True)
class Options:
    """What the user chooses.

    Attributes:
        nodes: How many sensor nodes; ``None``: one of each small profile, or one of a skin.
        skin: Profile of large skins that the nodes have; ``None``: small ones.
        port: Port of the dashboard.
        speed: Emulated seconds per second; ``None`` leaves it to each node's file.
        duration: Seconds to run once all is up; ``None`` runs until it is ended.
        lifetime: Of certificates, which are renewed when a third of it is left.
        embedded_broker: Whether Mosquitto is not used where it is installed.
    """

    nodes: int | None
    skin: str | None
    port: int
    speed: float | None
    duration: float | None
    lifetime: timedelta
    embedded_broker: bool


class _Stop(Exception):  # noqa: N818 - no error: the user asked
    """SIGTERM or SIGINT arrived."""


def run_demo(
    data: Path,
    options: Options,
    *,
    command: str,
    console: Console,
) -> None:
    """Run the whole stack until the duration is over, or SIGTERM or SIGINT.

    Args:
        data: Folder that keeps everything.
        options: Of the command.
        command: How a shell here calls ``eskin``, for hints.
        console: Takes progress and the URL.

    Raises:
        SettingsError: The folder or the port cannot be used.
        EskinError: A process did not come up.
    """
    layout = DemoFolder(data.resolve())
    with _locked(layout), _stop_on_signals():
        with suppress(_Stop):
            _run(layout, options, command=command, console=console)
        console.print(f"Stopped; the data stay in {layout.root}", soft_wrap=True, highlight=False)


def _run(layout: DemoFolder, options: Options, *, command: str, console: Console) -> None:
    mosquitto = None if options.embedded_broker else find_mosquitto()
    ports = _ports(options.port, one_for_all_parties=mosquitto is None)
    count = options.nodes or (len(PROFILES) if options.skin is None else 1)
    profiles = node_profiles(count, options.skin)
    names = list(profiles)
    lifetime = options.lifetime
    stack: Stack | None = None
    if not layout.store.exists():
        console.print("The first start compiles kernels, which takes about a minute.")
    try:
        with _progress(console) as progress:
            task = progress.add_task("identities", total=6)
            revoked = prepare_identities(layout, names, lifetime=lifetime)
            _require_own(layout, NEEDED & set(revoked))
            progress.advance(task)
            stack = Stack(
                layout,
                ports,
                profiles,
                speed=options.speed,
                revoked=revoked,
                mosquitto=mosquitto,
            )
            progress.update(task, description="store")
            token, login = _open_store(layout, ports)
            progress.advance(task)
            for stage in stack.stages(token):
                progress.update(task, description=stage.title)
                if not console.is_terminal:
                    console.print(f"starting {stage.title}", highlight=False)
                stack.start(stage)
                progress.advance(task)
            progress.update(task, description="all up")
        _greet(console, layout, login, command, mosquitto)
        for name in revoked:
            console.print(f"{name} was revoked, so it is kept out.", soft_wrap=True)
        _watch(stack, options.duration, lambda: renew_identities(layout, names, lifetime=lifetime))
    finally:
        if stack is not None:
            with _ignoring_signals(), console.status("Ending all processes in order …"):
                stack.stop()


def _ports(people: int, *, one_for_all_parties: bool) -> Ports:
    require_free(people)
    ingest, gateway, nodes, gateways, clients = free_ports(5)
    if one_for_all_parties:
        gateways = clients = nodes
    return Ports(people, ingest, BrokerPorts(nodes, gateways, clients), gateway)


def _require_own(layout: DemoFolder, revoked: frozenset[str]) -> None:
    """Refuse to start without a part that everything needs."""
    if revoked:
        name = min(revoked)
        raise SettingsError(
            "--data",
            f"{name} was revoked in {layout.authority}; remove {layout.identity(name)} to have a "
            "new certificate issued, or choose another folder",
        )


def _open_store(layout: DemoFolder, ports: Ports) -> tuple[str, str]:
    """Make the store, a token for scripts, and a login URL for a person."""
    layout.store.parent.mkdir(parents=True, exist_ok=True)
    scopes = (Scope.READ, Scope.OPERATE, Scope.BIOMETRIC)
    with Store(layout.store) as store:
        token = create_token(store, name="demo", scopes=scopes, lifetime=TOKEN_LIFETIME)
        code = create_login_code(store, lifetime=LOGIN_LIFETIME, scopes=scopes)
    write_access(layout, ports, token)
    return token, f"http://{LOOPBACK}:{ports.people}/login?code={code}"


def _greet(
    console: Console, layout: DemoFolder, login: str, command: str, mosquitto: Path | None
) -> None:
    broker = "embedded (amqtt)" if mosquitto is None else f"Mosquitto ({mosquitto})"

    console.print("\n[bold green]eskin is running.[/] Open this once, in a browser:\n")
    console.print(f"  {login}\n", soft_wrap=True, highlight=False)
    console.print(
        f"Broker: {broker}\n"
        f"Scripts and MQTT clients: {layout.access}\n"
        f"Check the data: {command} audit --data {layout.root}\n"
        "Ctrl-C ends it; the data stay.",
        soft_wrap=True,
        highlight=False,
    )


def _watch(stack: Stack, duration: float | None, renew: Callable[[], None]) -> None:
    deadline = None if duration is None else time.monotonic() + duration
    due = time.monotonic()
    while deadline is None or time.monotonic() < deadline:
        stack.keep_alive()
        if time.monotonic() >= due:
            due = time.monotonic() + _RENEW_S
            try:
                renew()
            except (IdentityError, LockedError, OSError) as error:
                log.warning("identities not renewed, trying again: %s", error)
        time.sleep(_WATCH_S)


def _progress(console: Console) -> Progress:
    return Progress(
        SpinnerColumn(finished_text="✓"),
        TextColumn("starting {task.description}"),
        BarColumn(),
        TextColumn("{task.completed}/{task.total}"),
        TimeElapsedColumn(),
        console=console,
    )


@contextmanager
def _locked(layout: DemoFolder) -> Iterator[None]:
    """Keep a second demo off the folder."""
    try:
        owner = LockFile(layout.owned)
    except LockedError as error:
        raise SettingsError(
            "--data", f"a demo runs on {layout.root} already; end it or choose another folder"
        ) from error
    except OSError as error:
        raise SettingsError("--data", f"{layout.root} cannot be used: {error.strerror}") from error
    with owner:
        yield


@contextmanager
def _stop_on_signals() -> Iterator[None]:
    def stop(number: int, frame: FrameType | None) -> None:
        del number, frame
        raise _Stop

    with _handled(stop):
        yield


@contextmanager
def _ignoring_signals() -> Iterator[None]:
    """The end in order is not cut short by a second Ctrl-C."""

    def ignore(number: int, frame: FrameType | None) -> None:
        del frame
        log.info("already ending: signal=%d", number)

    with _handled(ignore):
        yield


@contextmanager
def _handled(handler: signal._HANDLER) -> Iterator[None]:
    numbers = (signal.SIGTERM, signal.SIGINT)
    before = [signal.signal(number, handler) for number in numbers]
    try:
        yield
    finally:
        for number, old in zip(numbers, before, strict=True):
            signal.signal(number, old)
