"""``eskin subjects``: the subjects of biometric channels; only the site knows their names."""

from __future__ import annotations

import json
import os
import time
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from eskin.cli.tables import add_row, show
from eskin.errors import SettingsError
from eskin.wire.timestamp import format_timestamp

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_gateway.spool.subject_assignments import SubjectAssignments

    from eskin.privacy import KeyStore, Subject

_FRESH: Final = os.O_WRONLY | os.O_CREAT | os.O_EXCL
_DAMAGED: Final = b'{"damaged":'
_MOST_NAMED: Final = 20

subjects = typer.Typer()

Config = Annotated[
    Path, typer.Option(envvar="ESKIN_CONFIG", help="TOML file with the gateway's settings.")
]
Name = Annotated[
    str | None,
    typer.Option(help="The person's name; asked for if left out, so that it stays out of the "
                 "shell's history."),
]  # fmt: skip


@subjects.callback(invoke_without_command=True)
def overview(context: typer.Context) -> None:
    """Assign, list, export and erase persons: known by name at their site alone."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@subjects.command("list")
def list_subjects(config: Config) -> None:
    """List subjects: name, pseudonym, the nodes they wear, and what was erased."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    keystore, assignments = _open(config)
    worn: dict[str, list[str]] = {}
    for node, pseudonym in assignments.wearers().items():
        worn.setdefault(pseudonym, []).append(node)
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("name", "pseudonym", "wears", "state"):
        table.add_column(heading, overflow="fold")
    for subject in keystore.subjects():
        wears = " ".join(worn.get(subject.pseudonym, []))
        add_row(table, subject.name or "(unassigned)", subject.pseudonym, wears, "sealed")
    for tombstone in keystore.tombstones():
        add_row(table, "", tombstone.pseudonym, "", _state(tombstone.confirmed))
    show(table)


@subjects.command()
def assign(
    config: Config,
    node: Annotated[str, typer.Option(help="The node that the person wears from now on.")],
    name: Name = None,
) -> None:
    """Have a person wear a node from now on; what it measured before stays whose it is."""
    from eskin.privacy.subject import LONGEST_NAME

    keystore, assignments = _open(config)
    name = _asked(name)
    if not name.strip() or len(name) > LONGEST_NAME:
        raise SettingsError("--name", f"is empty or longer than {LONGEST_NAME} characters")
    _require_device(node, name)
    subject = keystore.person(name)
    assignments.assign(node, subject, since=time.time_ns())
    typer.echo(f"{node} is worn by {subject.pseudonym} from now on")


@subjects.command()
def release(
    config: Config, node: Annotated[str, typer.Option(help="The node to unassign.")]
) -> None:
    """Unassign a node; its data are encrypted under a fresh key."""
    keystore, assignments = _open(config)
    fresh = keystore.create()
    assignments.assign(node, fresh, since=time.time_ns())
    typer.echo(f"{node} is unassigned from now on ({fresh.pseudonym})")


@subjects.command()
def erase(
    config: Config,
    name: Name = None,
    pseudonym: Annotated[str | None, typer.Option(help="Or the pseudonym.")] = None,
) -> None:
    """Erase a person: destroy the key here now, and at the cloud; nothing brings the data back."""
    keystore, assignments = _open(config)
    if pseudonym is None:
        name = _asked(name)
    for gone in _find(keystore, name, pseudonym):
        nodes = assignments.release(gone.pseudonym, since=time.time_ns())
        keystore.erase(gone.pseudonym)
        typer.echo(f"{gone.pseudonym}: its key and name are destroyed here")
        for node in nodes:
            typer.echo(f"{node} is unassigned from now on")
    typer.echo("the running gateway has the cloud destroy its copy; `list` says when it did")


@subjects.command()
def export(
    config: Config,
    url: Annotated[str, typer.Option(help="Where the cloud is, such as https://skin.example:8080")],
    token: Annotated[
        Path, typer.Option(help="File with a token with the scopes read and biometric.")
    ],
    out: Annotated[Path, typer.Option(help="JSON lines; a new file, mode 0600.")],
    root: Annotated[
        Path | None,
        typer.Option(help="PEM file of the CA that certified the cloud; else the system's CAs."),
    ] = None,
    name: Name = None,
    site: Annotated[
        str | None, typer.Option(help="The site, where another one has that pseudonym, too.")
    ] = None,
) -> None:
    """Fetch all that the cloud holds of a person, for the person.

    The exit status is 1 if messages are damaged at the cloud: they are named, and left out.
    """
    import httpx

    from eskin.identity import client_context

    keystore, _ = _open(config)
    trusted = True if root is None else client_context(root)
    known = [subject.pseudonym for subject in _find(keystore, _asked(name), None)]
    headers = {"Authorization": f"Bearer {_secret(token)}"}
    params = {} if site is None else {"site": site}
    place = f"{url.rstrip('/')}/api/v1/subjects"
    try:
        with ExitStack() as asked:
            answers = []
            for each in (f"{place}/{pseudonym}/export" for pseudonym in known):
                question = httpx.stream(
                    "GET",
                    each,
                    params=params,
                    headers=headers,
                    timeout=60,
                    trust_env=False,
                    verify=trusted,
                )
                answers.append(asked.enter_context(question))
                if answers[-1].status_code != httpx.codes.OK:
                    raise SettingsError("--url", f"{each} answered {answers[-1].status_code}")
            _write(out, chain.from_iterable(answer.iter_bytes() for answer in answers))
    except httpx.HTTPError as error:
        raise SettingsError("--url", f"{place}: {error}") from error
    lines, damaged = _count(out)
    typer.echo(f"{out}: {lines - len(damaged)} lines of {', '.join(known)}")
    if damaged:
        for place in damaged[:_MOST_NAMED]:
            typer.echo(f"damaged in the store of the cloud, and left out: {place}", err=True)
        typer.echo(
            f"{len(damaged)} messages are left out; each has a line with `damaged` in {out}; "
            "restore a copy of the store from a backup, then export again",
            err=True,
        )
        raise typer.Exit(1)


def _secret(token: Path) -> str:
    try:
        return token.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError("--token", f"{token} cannot be read: {error}") from error


def _count(out: Path) -> tuple[int, list[str]]:
    """The number of lines, and the places of the damaged messages that some stand for."""
    lines, damaged = 0, []
    with out.open("rb") as file:
        for line in file:
            lines += 1
            if line.startswith(_DAMAGED):
                at = json.loads(line)
                damaged.append(f"{at['node']} boot {at['boot']} sequence {at['sequence']}")
    return lines, damaged


def _write(out: Path, parts: Iterator[bytes]) -> None:
    """Write a new file, whole or not at all."""
    try:
        with os.fdopen(os.open(out, _FRESH, 0o600), "wb") as file, ExitStack() as cut_off:
            cut_off.callback(out.unlink)
            for part in parts:
                file.write(part)
            file.flush()
            cut_off.pop_all()
    except OSError as error:
        raise SettingsError("--out", f"{out} cannot be written: {error.strerror}") from error


def _open(config: Path) -> tuple[KeyStore, SubjectAssignments]:
    from eskin_gateway.settings import GatewaySettings
    from eskin_gateway.spool.subject_assignments import SubjectAssignments

    from eskin.privacy import open_keystore

    settings = GatewaySettings.load(config)
    keystore = open_keystore(settings.keys, settings.keystore)
    return keystore, SubjectAssignments(keystore)


def _asked(name: str | None) -> str:
    """The name; asked for once the settings are known to be good."""
    return str(typer.prompt("Name")) if name is None else name


def _find(keystore: KeyStore, name: str | None, pseudonym: str | None) -> list[Subject]:
    if (name is None) == (pseudonym is None):
        raise SettingsError("--name, --pseudonym", "give one of them")
    if pseudonym is not None:
        return [keystore.find(pseudonym)]
    found = keystore.named(name) if name else []
    if not found:
        raise SettingsError("--name", "there is no such person; `eskin subjects list` shows all")
    return found


def _state(confirmed: int | None) -> str:
    if confirmed is None:
        return "erased here; the cloud has not confirmed yet"
    return f"erased; the cloud confirmed at {format_timestamp(confirmed).partition('.')[0]}Z"


def _require_device(node: str, name: str) -> None:
    """A node's id stands in certificates, topics and logs: it must not be the person's name."""
    for word in name.lower().split():
        if len(word) > 2 and word in node.lower():
            raise SettingsError(
                "--node", f"{node!r} holds part of the name; a node's id is a device's, give it one"
            )
