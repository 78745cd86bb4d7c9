"""``eskin cloud``: ingest, store, queries, dashboard; and who may look."""

from __future__ import annotations

import time
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from eskin.cli.tables import add_row, show
from eskin.errors import SettingsError
from eskin.identity import IdentityKind
from eskin.runtime.logs import start_logs
from eskin.runtime.printable import printable
from eskin.wire.timestamp import format_timestamp

if TYPE_CHECKING:
    from eskin_cloud.settings import CloudSettings, PeopleSection
    from sqlalchemy import URL

cloud = typer.Typer(help="Run a cloud, or give people and scripts access to it.")

_LOOPBACK: Final = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104 - nothing is bound here

Config = Annotated[
    Path | None, typer.Option(help="TOML file with the cloud's settings; also before the command.")
]


@cloud.callback(invoke_without_command=True)
def run(
    context: typer.Context,
    config: Annotated[
        Path | None, typer.Option(envvar="ESKIN_CONFIG", help="TOML file with its settings.")
    ] = None,
) -> None:
    """Run a cloud: ingest, store, queries, live, dashboard."""
    if context.invoked_subcommand is not None:
        context.obj = config
        return
    from eskin_ca.renewal_agent import RenewalAgent
    from eskin_cloud.service import run as serve

    settings = _load(config)
    start_logs(settings.log.level)
    people, gateways = settings.people, settings.gateways
    own = {gateways.identity} | ({people.identity} if people.identity else set())
    lists = {
        IdentityKind.GATEWAY: gateways.revocations,
        IdentityKind.NODE: settings.nodes.revocations,
    }
    with RenewalAgent(settings.renewal, sorted(own), lists=lists):
        serve(settings)


@cloud.command()
def login(
    context: typer.Context,
    config: Config = None,
    url: Annotated[
        str | None, typer.Option(help="How browsers reach it, such as https://skin.example:8080.")
    ] = None,
    minutes: Annotated[float, typer.Option(min=1, max=1440, help="How long it is good.")] = 15.0,
    biometric: Annotated[
        bool, typer.Option("--biometric", help="It shows biometric data, too.")
    ] = False,
) -> None:
    """Print a URL that logs in, once; also while the cloud runs."""
    from eskin_cloud.access import Scope, create_login_code
    from eskin_cloud.store import Store

    settings = _load(config or context.obj)
    scopes = {Scope.READ, Scope.OPERATE} | ({Scope.BIOMETRIC} if biometric else set())
    with Store(settings.store.place) as store:
        code = create_login_code(store, lifetime=timedelta(minutes=minutes), scopes=scopes)
    typer.echo(f"{(url or _origin(settings.people)).rstrip('/')}/login?code={code}")


@cloud.command()
def token(
    context: typer.Context,
    name: Annotated[str, typer.Option(help="Whose token it is, for people.")],
    config: Config = None,
    scope: Annotated[
        list[str] | None, typer.Option(help="read, operate, biometric or admin; may be repeated.")
    ] = None,
    days: Annotated[float, typer.Option(min=0.01, max=3650, help="Days it is good.")] = 30.0,
) -> None:
    """Print a bearer token for the REST API; it is shown only here."""
    from eskin_cloud.access import Scope, create_token
    from eskin_cloud.store import Store

    try:
        scopes = [Scope(item) for item in scope or ["read"]]
    except ValueError:
        allowed = ", ".join(Scope)
        raise typer.BadParameter(f"{scope} is not allowed; use {allowed}") from None
    with Store(_load(config or context.obj).store.place) as store:
        typer.echo(create_token(store, scopes=scopes, name=name, lifetime=timedelta(days=days)))


@cloud.command()
def tokens(context: typer.Context, config: Config = None) -> None:
    """List all tokens: whose they are, what they allow, whether they are good."""
    from eskin_cloud.access import list_tokens
    from eskin_cloud.schemas.access import TokenDocument
    from eskin_cloud.store import Store
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    with Store(_load(config or context.obj).store.place) as store, store.read() as connection:
        rows = [TokenDocument.of(row, now=store.clock()) for row in list_tokens(connection)]
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("id", "name", "scopes", "state", "expires"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        expires = (row.expires or "never").partition(".")[0]
        add_row(table, row.id, row.name, " ".join(row.scopes), row.state, expires)
    show(table)


@cloud.command()
def sessions(context: typer.Context, config: Config = None) -> None:
    """List the sessions of browsers that are good: who opened them, and what they allow."""
    from eskin_cloud.access import list_sessions
    from eskin_cloud.schemas.access import SessionDocument
    from eskin_cloud.store import Store
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    with Store(_load(config or context.obj).store.place) as store, store.read() as connection:
        found = list_sessions(connection, now=store.clock())
        rows = [SessionDocument.model_validate(row) for row in found]
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("id", "name", "scopes", "expires"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        expires = row.expires.partition(".")[0]
        add_row(table, row.id, row.name, " ".join(row.scopes), expires)
    show(table)


@cloud.command()
def revoke(
    context: typer.Context,
    number: Annotated[str, typer.Option("--id", help="Id as `tokens` or `sessions` lists it.")],
    config: Config = None,
) -> None:
    """Revoke a token with the sessions that it opened, or a session; also while the cloud runs."""
    from eskin_cloud.access import revoke_session, revoke_token
    from eskin_cloud.store import Store

    with Store(_load(config or context.obj).store.place) as store:
        if not revoke_token(store, number) and not revoke_session(store, number):
            raise SettingsError("--id", f"{number!r} is no token or session that could be revoked")
    typer.echo(f"revoked {number}")


@cloud.command()
def move(
    context: typer.Context,
    source: Annotated[
        Path, typer.Option("--from", exists=True, dir_okay=False, help="SQLite file to move.")
    ],
    config: Config = None,
) -> None:
    """Move a store from its SQLite file to where the settings say; goes on where it was."""
    from eskin_cloud.service import only_one
    from eskin_cloud.store import Store
    from eskin_cloud.store.move import move as carry
    from rich.console import Console
    from rich.progress import Progress

    target = _load(config or context.obj).store.place
    console = Console(stderr=True)
    bar = Progress(console=console, transient=True, disable=not console.is_terminal)
    with only_one(source), bar:
        Store(source).close()  # refuses what is no store
        task = bar.add_task("moving", total=None)
        counts = carry(
            source,
            target,
            now=time.time_ns(),
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    for name, count in counts.items():
        typer.echo(f"{count:12} {name}")
    typer.echo("moved, and compared page by page")


@cloud.command()
def distribute(
    context: typer.Context,
    config: Config = None,
    url: Annotated[
        str | None, typer.Option(help="The coordinator's database; else the settings' store.url.")
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Change nothing; check a cluster that runs.")
    ] = False,
) -> None:
    """Distribute an empty store over the servers of a Citus cluster, by the nodes' slots."""
    from eskin_cloud.store.distribute import check as verify
    from eskin_cloud.store.distribute import distribute as spread

    place = _coordinator(config or context.obj, url)
    servers = verify(place) if check else spread(place, now=time.time_ns())
    for each in servers:
        typer.echo(f"{len(each.slots):3} slots in {each.shards:3} shards  {each.name}")
    typer.echo("as it should be" if check else "distributed")


@cloud.command("audit-log")
def audit_log(context: typer.Context, config: Config = None) -> None:
    """Show who did what, oldest first, and check that nothing was changed afterwards."""
    from eskin_cloud.store import Store
    from eskin_cloud.store.write.audit_log import check_audit_entries, read_audit_entries

    with Store(_load(config or context.obj).store.place) as store, store.read() as connection:
        for row in read_audit_entries(connection):
            words = (format_timestamp(row["time"]), row["actor"] or "-", row["address"] or "-")
            audit_entry = " ".join((*words, row["action"], row["target"], row["detail"]))
            typer.echo(printable(audit_entry.rstrip()))
        broken = check_audit_entries(connection)
    if broken is not None:
        typer.echo(f"BROKEN: deed {broken} is missing or was changed afterwards", err=True)
        raise typer.Exit(1)


def _load(config: Path | None) -> CloudSettings:
    from eskin_cloud.settings import CloudSettings

    if config is None:
        raise SettingsError("--config", "is missing; write --config FILE.toml")
    return CloudSettings.load(config)


def _coordinator(config: Path | None, url: str | None) -> URL:
    """The server's database that a URL or the settings name.

    Raises:
        SettingsError: It is none that can be used.
    """
    from eskin_cloud.store.location import is_local, parse_url

    if url is None:
        if config is None:
            raise SettingsError("--url", "is missing; write --url URL, or --config FILE.toml")
        place = _load(config).store.place
        if isinstance(place, Path):
            raise SettingsError("store.path", "is an SQLite file; name a server in store.url")
        return place
    try:
        place = parse_url(url)
    except ValueError as error:
        raise SettingsError("--url", f"{url!r} {error}") from error
    if not is_local(place):
        raise SettingsError(
            "--url",
            "plaintext stays on loopback; write --config with store.url and store.root instead",
        )
    return place


def _origin(people: PeopleSection) -> str:
    """Where a browser on this machine reaches it."""
    host = _LOOPBACK.get(people.host, people.host)
    scheme = "http" if people.identity is None else "https"
    return f"{scheme}://{f'[{host}]' if ':' in host else host}:{people.port}"
