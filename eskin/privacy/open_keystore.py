"""Opening a key store as the settings say: master key in a file, or in hardware."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from eskin.errors import SettingsError
from eskin.privacy.keystore import KeyStore
from eskin.privacy.master_key import MASTER_FILE, FileMasterKey, wrapped_key
from eskin.runtime.files.atomic import make_folder

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.privacy.master_key import MasterKey
    from eskin.runtime.settings import KeysSection

log = logging.getLogger(__name__)


def open_keystore(settings: KeysSection, directory: Path) -> KeyStore:
    """Open a key store; make it where there is none.

    Args:
        settings: Where the master key is.
        directory: The key store's folder.

    Raises:
        PrivacyError: A file cannot be used.
        SettingsError: The hardware cannot be used.
    """
    make_folder(directory)
    return KeyStore(directory, _master(settings, directory))


def open_key(settings: KeysSection, directory: Path, name: str) -> bytes:
    """A key that is no subject's, wrapped in a file of its name; made where there is none.

    Args:
        settings: Where the master key is.
        directory: The key store's folder.
        name: Of the file, and what the key is good for.

    Raises:
        PrivacyError: A file cannot be used.
        SettingsError: The hardware cannot be used.
    """
    make_folder(directory)
    return wrapped_key(directory / name, _master(settings, directory))


def _warn_beside_data(master: Path, directory: Path) -> None:
    """Log a warning where the master key lies beside the data that it protects.

    Args:
        master: The file.
        directory: The key store's folder, which lies beside the data.
    """
    if master.resolve().is_relative_to(directory.resolve().parent):
        log.warning(
            "the master key protects nothing: it lies beside the data, so who takes the disk or a "
            "backup takes both; set keys.master to a file on another disk, or keys.module: "
            "master=%s keys=%s",
            master,
            directory,
        )


def _master(settings: KeysSection, directory: Path) -> MasterKey:
    if settings.module is None:
        path = settings.master or directory / MASTER_FILE
        _warn_beside_data(path, directory)
        return FileMasterKey(path)
    if settings.pin is None:
        raise SettingsError("keys.pin", "is missing; name a file (0600) that holds the token's PIN")
    try:
        from eskin.privacy.pkcs11 import Pkcs11MasterKey  # noqa: PLC0415 - an optional part
    except ImportError as error:
        raise SettingsError(
            "keys.module", "needs python-pkcs11; install eskin with its part 'hardware'"
        ) from error
    return Pkcs11MasterKey(settings.module, settings.token, settings.pin)
