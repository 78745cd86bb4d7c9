"""A server's certificate, read again when it was renewed."""

from __future__ import annotations

import logging
import ssl
from typing import TYPE_CHECKING

from eskin.errors import IdentityError, SettingsError
from eskin.identity.identity import CHAIN_FILE, KEY_FILE
from eskin.identity.tls import show
from eskin.runtime.files.stamp import version

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.runtime.files.stamp import Version

log = logging.getLogger(__name__)


class Certificate:
    """A server's certificate and key; a renewed one is taken without a restart.

    Args:
        setting: Name of the setting that holds the folder.
        folder: With ``chain.pem`` and ``key.pem``.

    Attributes:
        context: For TLS 1.2 and later.
        fault: Why a renewed certificate was not taken at the last look; ``None`` if it was.

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
        """Take a renewed certificate; gives whether there was one that can be used.

        What cannot be is said once, and tried again at the next look.
        """
        try:
            renewed = self._take()
        except (IdentityError, OSError) as error:
            if str(error) != self.fault:
                log.warning("renewed certificate not taken, trying again: %s", error)
            self.fault = str(error)
            return False
        self.fault = None
        return renewed

    def _take(self) -> bool:
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
