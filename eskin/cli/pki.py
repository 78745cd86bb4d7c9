"""``eskin pki``: who is who. A CA in a folder, and a CA service."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eskin.cli.tables import add_row, show
from eskin.errors import IdentityError, SettingsError
from eskin.identity import (
    CertificateAuthority,
    Identity,
    IdentityKind,
    RootRotation,
    new_key,
    numbered,
)
from eskin.identity.rotation import SPREAD
from eskin.runtime.logs import start_logs

if TYPE_CHECKING:
    from collections.abc import Sequence

Directory = Annotated[Path, typer.Option("--dir", file_okay=False, help="Folder of the CA.")]
OneKind = Annotated[IdentityKind | None, typer.Option("--kind", help="Its kind of identities.")]
Root = Annotated[bool, typer.Option("--root", help="The root, and with it the CAs of all kinds.")]
Force = Annotated[bool, typer.Option("--force", help="Without waiting for other parties.")]
pki = typer.Typer()
Url = Annotated[str, typer.Option(help="The CA service, such as https://ca:8444.")]
EnrolDirectory = Annotated[
    Path, typer.Option(help="Folder with root.pem and NAME.token, as the CA service left them.")
]
Name = Annotated[str, typer.Option(help="Common name, such as fingertip or gateway.g1.")]
Patience = Annotated[float, typer.Option(help="Seconds to keep trying.")]


def rotate(directory: Directory, kind: OneKind = None, root: Root = False) -> None:
    """Make a new CA beside the old one, whose certificates pass until it is retired.

    That of a kind issues from now on; a root with its CAs of all kinds, after `eskin pki switch`.
    """
    if _is_root(kind, root=root):
        RootRotation(CertificateAuthority(directory)).begin()
        typer.echo(
            "a new root is trusted by all that fetch it; once all have, `eskin pki switch` lets "
            "its CAs issue"
        )
    elif kind is not None:
        CertificateAuthority(directory).rotate(kind)
        typer.echo(f"a new {kind} CA issues from now on; `eskin pki retire` ends the old one")


def switch(directory: Directory, force: Force = False) -> None:
    """Let the new root's CAs issue, once all parties trust it; they renew by themselves then."""
    rotation = RootRotation(CertificateAuthority(directory))
    age = rotation.age()
    if age < SPREAD and not force:
        raise IdentityError(
            f"the new root is {age.total_seconds():.0f} s old, and not everybody may know it; wait "
            f"{SPREAD.total_seconds():.0f} s, or add --force"
        )
    rotation.switch()
    typer.echo("the new root's CAs issue from now on; `eskin pki retire --root` ends the old one")


def retire(
    directory: Directory, kind: OneKind = None, root: Root = False, force: Force = False
) -> None:
    """End the CA that was replaced, once all its certificates are renewed."""
    authority = CertificateAuthority(directory)
    if _is_root(kind, root=root):
        rotation = RootRotation(authority)
        _require_none(rotation.dependants(), "root", force=force)
        rotation.retire()
        typer.echo("the old root is retired")
    elif kind is not None:
        _require_none(authority.dependants(kind), f"{kind} CA", force=force)
        authority.retire(kind)
        typer.echo(f"the old {kind} CA is retired")


def _is_root(kind: IdentityKind | None, *, root: bool) -> bool:
    if (kind is None) != root:
        raise SettingsError("--kind", "name a kind of identities, or --root, and not both")
    return root


def _require_none(names: Sequence[str], what: str, *, force: bool) -> None:
    if names and not force:
        raise IdentityError(
            f"still of the old {what}: {', '.join(names[:10])}; wait until they are renewed, or "
            "add --force to lock them out"
        )


@pki.callback(invoke_without_command=True)
def overview(context: typer.Context) -> None:
    """Make, enrol, list and revoke identities."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@pki.command()
def init(directory: Directory) -> None:
    """Make a CA: a root, and one issuing CA for each kind of identity."""
    CertificateAuthority.create(directory)
    typer.echo(f"CA in {directory}; its root: {directory / 'root.pem'}")


@pki.command()
def issue(
    directory: Directory,
    kind: Annotated[IdentityKind, typer.Option(help="Kind of the identity.")],
    name: Name,
    out: Annotated[
        Path,
        typer.Option(
            help="Folder for key.pem, chain.pem and root.pem; with --count, for a folder each."
        ),
    ],
    site: Annotated[
        str, typer.Option(help="The site of a node or gateway, such as site.main.")
    ] = "",
    host: Annotated[list[str] | None, typer.Option(help="A server's name or address.")] = None,
    days: Annotated[float, typer.Option(min=0.001, max=398, help="Days of validity.")] = 90.0,
    count: Annotated[
        int, typer.Option(min=0, help="Issue to NAME-0001 and so on, for a fleet of so many nodes.")
    ] = 0,
) -> None:
    """Make a key and issue its certificate, on the CA's own machine."""
    from rich.console import Console
    from rich.progress import track

    names = numbered(name, count) if count else [name]
    folders = [out / each for each in names] if count else [out]
    for folder in folders:
        if (folder / "key.pem").exists():
            raise IdentityError(f"{folder}: there is an identity already; choose another folder")
    authority = CertificateAuthority(directory)
    pairs = list(zip(names, folders, strict=True))
    for each, folder in track(pairs, "issuing", console=Console(stderr=True), disable=not count):
        key = new_key()
        chain = authority.issue(
            kind,
            each,
            key.public_key(),
            site=site,
            hosts=host or (),
            lifetime=timedelta(days=days),
        )
        Identity.save(folder, key=key, chain=chain, roots=authority.roots)
    until = chain[0].not_valid_after_utc.isoformat()
    names_made = f"{names[0]} to {names[-1]}" if count else name
    typer.echo(f"{names_made} in {out}, valid until {until}")


@pki.command(name="list")
def list_(directory: Directory) -> None:
    """List all certificates ever issued."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("name", "kind", "site", "expires", "revoked", "serial"):
        table.add_column(heading, overflow="fold")
    for entry in CertificateAuthority(directory).issued():
        add_row(
            table,
            entry.name,
            entry.kind,
            entry.site or "-",
            entry.expires,
            entry.revoked or "-",
            entry.serial,
        )
    show(table)


@pki.command()
def tokens(directory: Directory) -> None:
    """List the CA service's enrolment tokens, and how often each was used."""
    from eskin_ca.tokens import TOKENS_FILE, Tokens
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("name", "kind", "site", "used", "of", "expires"):
        table.add_column(heading, overflow="fold")
    for each, used in Tokens(directory / TOKENS_FILE).listed():
        add_row(
            table,
            each.name,
            each.kind,
            each.site or "-",
            str(used),
            str(each.count or 1),
            each.expires,
        )
    show(table)


@pki.command()
def revoke(directory: Directory, name: Name) -> None:
    """Revoke all certificates of a name, and sign its kind's revocation list anew."""
    revoked = CertificateAuthority(directory).revoke(name)
    for entry in revoked:
        typer.echo(f"revoked {entry.name}, serial {entry.serial}")
    if not revoked:
        typer.echo(f"{name} was revoked before; its kind's revocation list is signed anew")


pki.command()(rotate)


pki.command()(switch)


pki.command()(retire)


@pki.command()
def sign(directory: Directory) -> None:
    """Sign all revocation lists anew, good for 7 days; a CA service does it by itself."""
    authority = CertificateAuthority(directory)
    for kind in IdentityKind:
        typer.echo(authority.write_revocations(kind))


@pki.command()
def renew(
    url: Url,
    identity: Annotated[Path, typer.Option(help="Folder of the identity.")],
    patience: Patience = 60.0,
) -> None:
    """Renew an identity now, with a fresh key; processes that use it take it without a restart."""
    from eskin_ca.client import fetch_roots
    from eskin_ca.client import renew as ask
    from eskin_ca.http_client import patiently

    patiently(lambda: fetch_roots(url, identity), patience)
    own = patiently(lambda: ask(url, identity), patience)
    typer.echo(f"{own.name} until {own.certificate.not_valid_after_utc.isoformat()}")


@pki.command()
def guard(
    url: Url,
    identity: Annotated[Path, typer.Option(help="Folder of the broker's identity.")],
    folder: Annotated[Path, typer.Option(help="Folder for anchors, lists and control.sock.")],
    argv: Annotated[list[str], typer.Argument(help="The broker: mosquitto -c FILE.")],
    also: Annotated[list[Path] | None, typer.Option(help="Further identity to renew.")] = None,
) -> None:
    """Run Mosquitto with renewed certificates, and end connections of revoked clients."""
    from eskin_ca.mosquitto_agent import MosquittoAgent
    from eskin_ca.renewal_agent import RenewalAgent

    from eskin.runtime.settings import RenewalSection

    start_logs("INFO")
    with RenewalAgent(RenewalSection(url=url), [identity, *(also or ())]):
        status = MosquittoAgent(argv, identity=identity, url=url, folder=folder).run()
    raise typer.Exit(status)


@pki.command()
def serve(
    config: Annotated[
        Path,
        typer.Option(envvar="ESKIN_CONFIG", help="TOML file with the CA service's settings."),
    ],
) -> None:
    """Run the CA service: HTTPS, one-time enrolment tokens, certificate requests only."""
    from eskin_ca.service import run
    from eskin_ca.settings import CaSettings

    settings = CaSettings.load(config)
    for expected in settings.identity:
        if not expected.directory.is_dir():
            raise SettingsError(
                "identity.directory",
                f"{expected.directory}, for the token of {expected.name}, is no folder; make it",
            )
    start_logs(settings.log.level)
    run(settings)


@pki.command()
def enrol(
    url: Url,
    enrol_dir: EnrolDirectory,
    kind: Annotated[IdentityKind, typer.Option(help="Kind of the identity.")],
    name: Name,
    out: Annotated[
        Path,
        typer.Option(
            help="Folder for key.pem, chain.pem and root.pem; with --count, for a folder each."
        ),
    ],
    patience: Patience = 60.0,
    count: Annotated[
        int,
        typer.Option(
            min=0, help="Enrol NAME-0001 and so on with one token, NAME.token; resumable."
        ),
    ] = 0,
) -> None:
    """Make a key here and have it certified by the CA service; the key never leaves."""
    from eskin_ca.client import enrol as ask
    from eskin_ca.http_client import patiently

    kind.require_name(name)
    if count:
        _enrol_fleet(url, enrol_dir, name, count, out, patience)
        return
    identity = patiently(lambda: ask(url, enrol_dir, name, out), patience)
    typer.echo(f"{identity.name} in {out}")


def _enrol_fleet(
    url: str, enrol_dir: Path, name: str, count: int, out: Path, patience: float
) -> None:
    from eskin_ca.client import enrol_fleet
    from rich.console import Console
    from rich.progress import track

    enrolled = enrol_fleet(url, enrol_dir, name, count, out, patience=patience)
    bar = track(enrolled, "enrolling", total=count, console=Console(stderr=True))
    names = [own.name for own in bar]
    typer.echo(f"{names[0]} to {names[-1]} in {out}")


@pki.command()
def fetch(
    url: Url,
    enrol_dir: EnrolDirectory,
    name: Name,
    out: Annotated[Path, typer.Option(help="PEM file to write.")],
    patience: Patience = 60.0,
) -> None:
    """Fetch a certificate, such as the site's for its nodes; wait until it is issued."""
    from eskin_ca.client import fetch as ask
    from eskin_ca.http_client import patiently

    patiently(lambda: ask(url, enrol_dir, name, out), patience)
    typer.echo(f"{name} in {out}")


@pki.command()
def anchor(
    url: Url,
    enrol_dir: EnrolDirectory,
    kind: Annotated[IdentityKind, typer.Option(help="Kind of the identities to accept.")],
    out: Annotated[Path, typer.Option(help="PEM file to write.")],
    patience: Patience = 60.0,
) -> None:
    """Fetch the CA certificate with which a TLS server accepts one kind alone, as a broker does."""
    from eskin_ca.client import fetch_anchor as ask
    from eskin_ca.http_client import patiently

    patiently(lambda: ask(url, enrol_dir, kind, out), patience)
    typer.echo(f"anchor of {kind} in {out}")
