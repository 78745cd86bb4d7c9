"""A server's certificate, read again when it was renewed."""

from __future__ import annotations

import ssl
from typing import TYPE_CHECKING

from eskin.errors import SettingsError

if TYPE_CHECKING:
    from pathlib import Path


class Certificate:
    """A server's certificate and key; a renewed one is taken without a restart.

    Args:
        setting: Name of the setting that holds the folder.
        folder: With ``chain.pem`` and ``key.pem``.

    Attributes:
        context: For TLS 1.2 and later.

    Raises:
        SettingsError: They cannot be used.
    """

    def __init__(self, setting: str, folder: Path) -> None:
        self._chain, self._key = folder / "chain.pem", folder / "key.pem"
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.context.minimum_version = ssl.TLSVersion.TLSv1_2
        try:
            self._version = self._stat()
            self.context.load_cert_chain(self._chain, self._key)
        except (OSError, ssl.SSLError) as error:
            raise SettingsError(
                setting, f"{folder}: chain.pem and key.pem cannot be used: {error}"
            ) from error

    def refresh(self) -> bool:
        """Take a renewed certificate; gives whether there was one.

        Raises:
            OSError: It cannot be used (ssl.SSLError is one, too).
        """
        version = self._stat()
        if version == self._version:
            return False
        self._version = version
        self.context.load_cert_chain(self._chain, self._key)
        return True

    def _stat(self) -> tuple[int, int]:
        found = self._chain.stat()
        return found.st_mtime_ns, found.st_ino
