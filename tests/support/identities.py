"""Identities for tests, made fresh by a CA of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.identity import CertificateAuthority, Identity, IdentityKind, new_key

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime, timedelta
    from pathlib import Path

SITE: Final = "site.main"


class Identities:
    """A CA in a folder, and the parties that most tests need.

    ``node`` is ``fingertip``, ``site`` is ``site.main``, ``gateway`` is ``gateway.g1``,
    ``ca`` the CA's folder.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self.ca = directory / "ca"
        self.authority = CertificateAuthority.open(self.ca)
        self.node = self.make(IdentityKind.NODE, "fingertip")
        self.site = self.make(IdentityKind.SITE, "site.main")
        self.gateway = self.make(IdentityKind.GATEWAY, "gateway.g1")

    def make(
        self,
        kind: IdentityKind,
        name: str,
        *,
        site: str = SITE,
        hosts: Sequence[str] = ("127.0.0.1", "localhost"),
        now: datetime | None = None,
        lifetime: timedelta | None = None,
    ) -> Identity:
        """Issue an identity and save it in a folder of its name."""
        key = new_key()
        extra = {} if lifetime is None else {"lifetime": lifetime}
        chain = self.authority.issue(
            kind,
            name,
            key.public_key(),
            site=site if kind.has_site else "",
            hosts=hosts,
            now=now,
            **extra,
        )
        roots = self.authority.roots
        return Identity.save(self._directory / name, key=key, chain=chain, roots=roots)
