"""The gateway's identity and its site's keys, reloaded when they are renewed."""

from __future__ import annotations

import logging
from random import SystemRandom
from typing import TYPE_CHECKING, Final

from eskin.errors import IdentityError, SettingsError
from eskin.identity import Identity, IdentityKind, client_context, past_identities
from eskin.identity.identity import CHAIN_FILE, ROOT_FILE
from eskin.runtime.files.stamp import version
from eskin.runtime.supervised import Backoff, Supervised
from eskin.wire.envelope import Opener

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from cryptography import x509

    from eskin.runtime.files.stamp import Version
    from eskin_gateway.settings import IdentitySection

log = logging.getLogger(__name__)

_POLL_S: Final = 1.0


class Keyring:
    """Reloads renewed files every second. Messages sealed to an older site key still open.

    Args:
        settings: The folders.

    Attributes:
        gateway: The gateway's identity.
        context: TLS context with the gateway's certificate.

    Raises:
        EskinError: An identity cannot be used.
    """

    def __init__(self, settings: IdentitySection) -> None:
        self._settings = settings
        # Unknown until the first refresh, so that a renewal during the start is not missed.
        self._versions: tuple[Version, ...] = ()
        self.gateway = _load("identity.directory", settings.directory, IdentityKind.GATEWAY)
        self.context = client_context(self.gateway.directory / ROOT_FILE, self.gateway)
        self._site = _load("identity.site", settings.site, IdentityKind.SITE)
        if self._site.name != self.gateway.site:
            raise SettingsError(
                "identity.site",
                f"{settings.site} is {self._site.name}, and {self.gateway.name} is a gateway of "
                f"{self.gateway.site}",
            )
        self._sites = self._load_sites()
        self._opener: Opener | None = None
        backoff = Backoff(_POLL_S, _POLL_S, random=SystemRandom())
        self._thread = Supervised("keyring", self._step, backoff=backoff, idle_s=_POLL_S)

    def make_opener(self, sender: Callable[[bytes], x509.Certificate | None]) -> Opener:
        """Make an opener that follows the site's renewals."""
        self._opener = Opener(list(self._sites.values()), sender=sender)
        return self._opener

    def find_site(self, thumbprint: bytes) -> Identity:
        """The site's identity to which a node sealed last, else the newest."""
        addressed = None if self._opener is None else self._opener.addressed(thumbprint)
        return self._sites.get(addressed or b"", self._site)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._thread.stop()

    def _step(self) -> bool:
        self.refresh()
        self._thread.succeeded()
        return False

    def refresh(self) -> None:
        """Reload renewed files.

        Raises:
            IdentityError: They cannot be used (yet).
        """
        versions = self._read_versions()
        if versions == self._versions:
            return
        self.gateway = Identity.load(self._settings.directory)
        self._site = Identity.load(self._settings.site)
        self._sites = self._load_sites()
        if self._opener is not None:
            self._opener.take(list(self._sites.values()))
        if self._versions:
            log.info("identities renewed")
        self._versions = versions

    def _load_sites(self) -> dict[bytes, Identity]:
        sites = [self._site, *past_identities(self._settings.site)]
        return {site.thumbprint: site for site in sites}

    def _read_versions(self) -> tuple[Version, ...]:
        folders = self._settings.directory, self._settings.site
        try:
            return tuple(version(folder / CHAIN_FILE) for folder in folders)
        except OSError as error:
            raise IdentityError(f"an identity cannot be read: {error}") from error


def _load(setting: str, directory: Path, kind: IdentityKind) -> Identity:
    identity = Identity.load(directory)
    if identity.kind is not kind:
        raise SettingsError(setting, f"{directory} holds a {identity.kind}; a {kind} is needed")
    return identity
