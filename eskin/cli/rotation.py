"""``eskin pki rotate``, ``switch`` and ``retire``: replacing CAs under way."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eskin.errors import IdentityError, SettingsError
from eskin.identity import CertificateAuthority, IdentityKind, RootRotation
from eskin.identity.rotation import SPREAD

if TYPE_CHECKING:
    from collections.abc import Sequence

Directory = Annotated[Path, typer.Option("--dir", file_okay=False, help="Folder of the CA.")]
OneKind = Annotated[IdentityKind | None, typer.Option("--kind", help="Its kind of identities.")]
Root = Annotated[bool, typer.Option("--root", help="The root, and with it the CAs of all kinds.")]
Force = Annotated[bool, typer.Option("--force", help="Without waiting for other parties.")]


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
