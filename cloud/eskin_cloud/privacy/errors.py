"""Errors about sealed messages."""

from __future__ import annotations

from eskin.errors import NoKeyError, PrivacyError


class BiometricAccessError(PrivacyError):
    """The caller may not read biometric channels here."""


class ErasedError(PrivacyError):
    """All that was asked for is of subjects whose keys are not here."""

    def __init__(self, cause: NoKeyError) -> None:
        super().__init__(f"nothing of this window can be read: {cause}")
        self.erased = cause.erased
