"""What tells of a person: which channels, sealed under a key for each subject, until erased."""

from __future__ import annotations

from eskin.privacy.biometric import is_biometric
from eskin.privacy.cipher import Unveiler, Veiler
from eskin.privacy.keys import open_key, open_vault
from eskin.privacy.master import FileMaster, Master
from eskin.privacy.subject import Subject, Tombstone
from eskin.privacy.unread import tells_of_nobody
from eskin.privacy.vault import Vault
from eskin.privacy.veiled import Veiled, is_veiled

__all__ = [
    "FileMaster",
    "Master",
    "Subject",
    "Tombstone",
    "Unveiler",
    "Vault",
    "Veiled",
    "Veiler",
    "is_biometric",
    "is_veiled",
    "open_key",
    "open_vault",
    "tells_of_nobody",
]
