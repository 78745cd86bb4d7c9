"""The demo's own PKI: made at the first start, renewed at a later one before it expires."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

from eskin.identity import Authority, Identity, IdentityKind, new_key

if TYPE_CHECKING:
    from collections.abc import Sequence

    from demo.layout import Layout

BROKER: Final = "server.broker"
CLOUD: Final = "server.cloud"
GATEWAY: Final = "gateway.demo"
SITE: Final = "site.demo"
CLIENT: Final = "client.demo"
NEEDED: Final = frozenset({BROKER, CLOUD, GATEWAY, SITE})
"""Without one of these nothing runs."""
_HOSTS: Final = ("127.0.0.1", "localhost")
_LEFT: Final = timedelta(days=30)


def prepare_identities(layout: Layout, nodes: Sequence[str]) -> list[str]:
    """Make or renew all identities, and sign all revocation lists anew.

    Returns:
        Names that were revoked: they keep their certificates, and nobody lets them in.

    Raises:
        IdentityError: The folder cannot be read or written.
    """
    authority = Authority.open(layout.authority)
    revoked = []
    for kind, name in (
        (IdentityKind.SERVER, BROKER),
        (IdentityKind.SERVER, CLOUD),
        (IdentityKind.GATEWAY, GATEWAY),
        (IdentityKind.SITE, SITE),
        (IdentityKind.CLIENT, CLIENT),
        *((IdentityKind.NODE, node) for node in nodes),
    ):
        if not _prepare(authority, layout, kind, name):
            revoked.append(name)
    for kind in IdentityKind:
        authority.write_revocations(kind)
    return revoked


def _prepare(authority: Authority, layout: Layout, kind: IdentityKind, name: str) -> bool:
    directory = layout.identity(name)
    key = new_key()
    if (directory / "chain.pem").exists():
        standing = Identity.load(directory)
        if authority.is_revoked(standing.certificate):
            return False
        if standing.certificate.not_valid_after_utc - datetime.now(UTC) > _LEFT:
            return True
        key = standing.key
    hosts = _HOSTS if kind is IdentityKind.SERVER else ()
    chain = authority.issue(kind, name, key.public_key(), hosts=hosts)
    Identity.save(directory, key=key, chain=chain, root=authority.root)
    return True
