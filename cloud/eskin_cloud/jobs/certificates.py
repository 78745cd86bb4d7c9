"""Server certificates: renewed files are loaded without a restart."""

from __future__ import annotations

import logging
import ssl
from typing import TYPE_CHECKING, Final

from eskin.errors import IdentityError, SettingsError
from eskin.identity.identity import CHAIN_FILE, KEY_FILE
from eskin.identity.tls import show
from eskin.runtime.files.stamp import version
from eskin_cloud.jobs.periodic import run_periodically

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Sequence
    from pathlib import Path

    from eskin.runtime.files.stamp import Version
    from eskin_cloud.app_state import AppState

log = logging.getLogger(__name__)

_INTERVAL_S: Final = 1.0


async def renew_certificates(
    cloud: AppState, certificates: Sequence[ServerCertificate], stopping: asyncio.Event
) -> None:
    """Look for renewed certificates each second."""

    async def refresh() -> None:
        for certificate in certificates:
            if certificate.refresh():
                log.info("certificate renewed")

    await run_periodically(
        "certificates", refresh, cloud=cloud, stopping=stopping, every_s=_INTERVAL_S
    )


class ServerCertificate:
    """A server's certificate and key.

    Args:
        setting: Name of the setting that holds the folder.
        folder: With ``chain.pem`` and ``key.pem``.

    Attributes:
        context: For TLS 1.2 and later.
        fault: Why the last look rejected a renewed certificate; ``None`` if it did not.

    Raises:
        SettingsError: They cannot be used.
    """

    def __init__(self, setting: str, folder: Path) -> None:
        self._folder = folder
        self.fault: str | None = None
        self.context = _context()
        try:
            self._shown = self._versions()
            show(self.context, folder)
        except (IdentityError, OSError) as error:
            raise SettingsError(
                setting, f"{folder}: chain.pem and key.pem cannot be used: {error}"
            ) from error

    def refresh(self) -> bool:
        """Load a renewed certificate; returns whether there was a usable one.

        An unusable one is logged once, and tried again at the next look.
        """
        try:
            renewed = self._load()
        except (IdentityError, OSError) as error:
            if str(error) != self.fault:
                log.warning("renewed certificate rejected, retrying: reason=%s", error)
            self.fault = str(error)
            return False
        self.fault = None
        return renewed

    def _load(self) -> bool:
        versions = self._versions()
        if versions == self._shown:
            return False
        # A context that fails is left with a certificate whose key it does not have.
        show(_context(), self._folder)
        show(self.context, self._folder)
        self._shown = versions
        return True

    def _versions(self) -> tuple[Version, Version]:
        return version(self._folder / CHAIN_FILE), version(self._folder / KEY_FILE)


def _context() -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    return context
