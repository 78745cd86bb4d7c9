"""Biometric data: which channels, and encryption under a key for each subject."""

from __future__ import annotations

from eskin.privacy.biometric import is_not_biometric
from eskin.privacy.cipher import Decryptor, Encryptor
from eskin.privacy.key_erasure import Tombstone
from eskin.privacy.keystore import KeyStore
from eskin.privacy.master_key import FileMasterKey, MasterKey
from eskin.privacy.open_keystore import open_key, open_keystore
from eskin.privacy.sealed_message import SealedMessage, is_sealed
from eskin.privacy.subject import Subject
from eskin.wire.biometric import is_biometric

__all__ = [
    "Decryptor",
    "Encryptor",
    "FileMasterKey",
    "KeyStore",
    "MasterKey",
    "SealedMessage",
    "Subject",
    "Tombstone",
    "is_biometric",
    "is_not_biometric",
    "is_sealed",
    "open_key",
    "open_keystore",
]
