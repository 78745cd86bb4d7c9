"""The node's keys and certificates, reloaded when they are renewed."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from eskin.errors import IdentityError
from eskin.identity import (
    Identity,
    client_context,
    load_certificates,
    past_identities,
    thumbprint,
)
from eskin.identity.identity import CHAIN_FILE, ROOT_FILE
from eskin.runtime.files.stamp import version
from eskin.wire.envelope import Opener, Sealer

if TYPE_CHECKING:
    from pathlib import Path

    from cryptography import x509

    from eskin.runtime.files.stamp import Version

log = logging.getLogger(__name__)

_POLL_S: Final = 1.0


class NodeKeys:
    """The node's identity and its site's certificate, read again when their files change.

    Answers that were sealed to an older certificate, or by an older one of the site, still open.

    Args:
        directory: The node's identity.
        site: File with its site's certificate.

    Attributes:
        own: The node's identity.
        sealer: Seals to the site.
        opener: Opens what the site sealed.
        context: Shows the node to the broker.

    Raises:
        IdentityError: A key or certificate cannot be used.
    """

    __slots__ = (
        "_directory", "_fault", "_polled", "_seen", "_site", "_sites", "context", "opener", "own",
        "sealer",
    )  # fmt: skip

    def __init__(self, directory: Path, site: Path) -> None:
        self._directory = directory
        self._site = site
        self._sites: dict[bytes, x509.Certificate] = {}
        self._polled = float("-inf")
        self._fault: str | None = None
        self._seen = self._state()
        self.own = Identity.load(directory)
        self.context = client_context(self.own.directory / ROOT_FILE, self.own)
        self.sealer = self._make_sealer()
        self.opener = Opener([self.own, *past_identities(self.own.directory)], sender=self._find)

    def refresh(self, now: float) -> bool:
        """Reload renewed files; returns whether there were any.

        Args:
            now: Monotonic seconds.
        """
        if now < self._polled + _POLL_S:
            return False
        self._polled = now
        try:
            state = self._state()
            if state == self._seen:
                return False
            own = Identity.load(self._directory)
            self.opener.take([own, *past_identities(own.directory)])
            self.own = own
            self.sealer = self._make_sealer()
        except IdentityError as error:
            if str(error) != self._fault:
                log.warning("renewed identity not loaded, retrying: error=%s", error)
            self._fault = str(error)
            return False
        self._seen = state
        self._fault = None
        log.info("identity renewed: name=%s", own.name)
        return True

    def _make_sealer(self) -> Sealer:
        site = load_certificates(self._site)[0]
        self._sites[thumbprint(site)] = site
        return Sealer(self.own, site)

    def _find(self, named: bytes) -> x509.Certificate | None:
        return self._sites.get(named)

    def _state(self) -> tuple[Version, ...]:
        try:
            return version(self._directory / CHAIN_FILE), version(self._site)
        except OSError as error:
            raise IdentityError(f"an identity cannot be read: {error}") from error
