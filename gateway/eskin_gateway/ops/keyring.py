"""The gateway's own identity and its site's keys, which are renewed while it runs."""

from __future__ import annotations

import logging
from threading import Event, Thread
from typing import TYPE_CHECKING, Final

from eskin.errors import IdentityError, SettingsError
from eskin.identity import Identity, IdentityKind, client_context, past_identities
from eskin.identity.identity import CHAIN_FILE, ROOT_FILE
from eskin.runtime.files.stamp import version
from eskin.wire.envelope import Opener

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from cryptography import x509

    from eskin.runtime.files.stamp import Version
    from eskin_gateway.settings import IdentitySection

log = logging.getLogger(__name__)

_LOOK_S: Final = 1.0


class Keyring:
    """Looks for renewed files every second. What was sealed to an older site key still opens.

    Args:
        settings: The folders.

    Attributes:
        gateway: The gateway's identity.
        context: Shows it to the broker.

    Raises:
        EskinError: An identity cannot be used.
    """

    def __init__(self, settings: IdentitySection) -> None:
        self._settings = settings
        # Unknown until the first look: so a renewal during the start is not missed.
        self._seen: tuple[Version, ...] = ()
        self.gateway = _identity("identity.directory", settings.directory, IdentityKind.GATEWAY)
        self.context = client_context(self.gateway.directory / ROOT_FILE, self.gateway)
        self._site = _identity("identity.site", settings.site, IdentityKind.SITE)
        if self._site.name != self.gateway.site:
            raise SettingsError(
                "identity.site",
                f"{settings.site} is {self._site.name}, and {self.gateway.name} is a gateway of "
                f"{self.gateway.site}",
            )
        self._sites = self._load_sites()
        self._opener: Opener | None = None
        self._stopping = Event()
        self._thread = Thread(target=self._run, name="keyring", daemon=True)

    def make_opener(self, sender: Callable[[bytes], x509.Certificate | None]) -> Opener:
        """An opener that follows the site's renewals."""
        self._opener = Opener(list(self._sites.values()), sender=sender)
        return self._opener

    def answering(self, named: bytes) -> Identity:
        """The site's identity that a node knows: to which it sealed last, else the newest."""
        addressed = None if self._opener is None else self._opener.addressed(named)
        return self._sites.get(addressed or b"", self._site)

    def start(self) -> None:
        """Look, in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._stopping.set()
        self._thread.join()

    def refresh(self) -> None:
        """Take over what was renewed.

        Raises:
            IdentityError: It cannot be used (yet).
        """
        state = self._state()
        if state == self._seen:
            return
        self.gateway = Identity.load(self._settings.directory)
        self._site = Identity.load(self._settings.site)
        self._sites = self._load_sites()
        if self._opener is not None:
            self._opener.take(list(self._sites.values()))
        if self._seen:
            log.info("identities renewed")
        self._seen = state

    def _run(self) -> None:
        fault = None
        while not self._stopping.wait(_LOOK_S):
            try:
                self.refresh()
                fault = None
            except IdentityError as error:
                if str(error) != fault:
                    log.warning("renewed identity not taken, trying again: %s", error)
                fault = str(error)
            except Exception as error:  # those that it has are good, until another look
                if repr(error) != fault:
                    log.exception("renewed identity not taken, trying again")
                fault = repr(error)

    def _load_sites(self) -> dict[bytes, Identity]:
        own = [self._site, *past_identities(self._settings.site)]
        return {site.thumbprint: site for site in own}

    def _state(self) -> tuple[Version, ...]:
        folders = self._settings.directory, self._settings.site
        try:
            return tuple(version(folder / CHAIN_FILE) for folder in folders)
        except OSError as error:
            raise IdentityError(f"an identity cannot be read: {error}") from error


def _identity(setting: str, directory: Path, kind: IdentityKind) -> Identity:
    identity = Identity.load(directory)
    if identity.kind is not kind:
        raise SettingsError(setting, f"{directory} holds a {identity.kind}; a {kind} is needed")
    return identity
