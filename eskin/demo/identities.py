"""The demo's own PKI: made at the first start, renewed before it expires, also under way."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from eskin.identity import (
    CertificateAuthority,
    Identity,
    IdentityKind,
    finish_renewal,
    forget_past,
    install,
    is_due,
    is_superseded,
    new_key,
    next_key,
)
from eskin.identity.identity import ROOT_FILE, write_whole

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import timedelta
    from pathlib import Path

    from eskin.demo.layout import DemoFolder

BROKER: Final = "server.broker"
CLOUD: Final = "server.cloud"
GATEWAY: Final = "gateway.demo"
SITE: Final = "site.demo"
CLIENT: Final = "client.demo"
NEEDED: Final = frozenset({BROKER, CLOUD, GATEWAY, SITE})
"""Without one of these nothing runs."""
_HOSTS: Final = ("127.0.0.1", "localhost")


def prepare_identities(
    layout: DemoFolder, nodes: Sequence[str], *, lifetime: timedelta
) -> list[str]:
    """Make or renew all identities, and sign all revocation lists anew.

    Args:
        layout: Where they lie.
        nodes: Names of the nodes.
        lifetime: Of the certificates.

    Returns:
        Names that were revoked: they keep their certificates, and all servers reject them.

    Raises:
        IdentityError: The folder cannot be read or written.
    """
    authority = CertificateAuthority.open(layout.authority)
    revoked = []
    for kind, name in _parties(nodes):
        if not _prepare(authority, layout.identity(name), kind, name, lifetime):
            revoked.append(name)
    for kind in IdentityKind:
        authority.write_revocations(kind)
    return revoked


def renew_identities(layout: DemoFolder, nodes: Sequence[str], *, lifetime: timedelta) -> None:
    """Renew what is due, and the revocation lists; all processes take it without a restart.

    Raises:
        IdentityError: The folder cannot be read or written.
    """
    authority = CertificateAuthority.open(layout.authority)
    for kind, name in _parties(nodes):
        _prepare(authority, layout.identity(name), kind, name, lifetime)
    for kind in IdentityKind:
        authority.refresh_revocations(kind)


def _parties(nodes: Sequence[str]) -> list[tuple[IdentityKind, str]]:
    return [
        (IdentityKind.SERVER, BROKER),
        (IdentityKind.SERVER, CLOUD),
        (IdentityKind.GATEWAY, GATEWAY),
        (IdentityKind.SITE, SITE),
        (IdentityKind.CLIENT, CLIENT),
        *((IdentityKind.NODE, node) for node in nodes),
    ]


def _prepare(
    authority: CertificateAuthority,
    directory: Path,
    kind: IdentityKind,
    name: str,
    lifetime: timedelta,
) -> bool:
    hosts = _HOSTS if kind is IdentityKind.SERVER else ()
    site = SITE if kind.has_site else ""
    if not (directory / "chain.pem").exists():
        key = new_key()
        chain = authority.issue(
            kind, name, key.public_key(), site=site, hosts=hosts, lifetime=lifetime
        )
        Identity.save(directory, key=key, chain=chain, roots=authority.roots)
        return True
    now = datetime.now(UTC)
    finish_renewal(directory)
    if (directory / ROOT_FILE).read_bytes() != authority.root_file.read_bytes():
        write_whole(directory / ROOT_FILE, authority.root_file.read_bytes())
    standing = Identity.load(directory)
    # An identity that is revoked meanwhile is not renewed.
    with authority.changing():
        if authority.register.is_revoked(standing.certificate):
            return False
        forget_past(directory, now)
        if is_due(standing.certificate, now) or is_superseded(standing):
            key = next_key(directory)
            chain = authority.issue(
                kind, name, key.public_key(), site=site, hosts=hosts, lifetime=lifetime
            )
            install(directory, chain)
    return True
