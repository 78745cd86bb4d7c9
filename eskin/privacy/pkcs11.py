"""A master key inside hardware, by PKCS#11 (OASIS, version 2.40 and later): it never comes out."""

from __future__ import annotations

import os
from threading import Lock
from typing import TYPE_CHECKING, Any, Final

import pkcs11
from pkcs11.mechanisms import GCMParams, KeyType, Mechanism

from eskin.errors import PrivacyError
from eskin.privacy.master_key import NONCE_BYTES
from eskin.runtime.files.atomic import read_private

if TYPE_CHECKING:
    from pathlib import Path

LABEL: Final = "eskin master key"
"""Label of the key on the token."""


class Pkcs11MasterKey:
    """A master key on a token; made there, neither readable nor extractable, where there is none.

    Args:
        module: PKCS#11 library of the hardware.
        token: The token's label.
        pin: File (0600) with the user's PIN.

    Raises:
        PrivacyError: The token cannot be used.
    """

    def __init__(self, module: Path, token: str, pin: Path) -> None:
        self._token = token
        self._lock = Lock()
        secret = read_private(pin).decode(errors="replace").strip()
        try:
            found = pkcs11.lib(str(module)).get_token(token_label=token)
            self._session = _sign_in(found, secret)
            self._key = self._find() or self._make()
        except (pkcs11.PKCS11Error, RuntimeError, OSError) as error:
            raise PrivacyError(f"token {token!r} of {module} cannot be used: {error!r}") from error

    def wrap(self, data: bytes, context: bytes) -> bytes:
        """See `Master.wrap`.

        Raises:
            PrivacyError: See there.
        """
        nonce = os.urandom(NONCE_BYTES)
        try:
            with self._lock:
                sealed: bytes = self._key.encrypt(
                    data, mechanism=Mechanism.AES_GCM, mechanism_param=_parameters(nonce, context)
                )
        except pkcs11.PKCS11Error as error:
            raise PrivacyError(f"token {self._token!r} cannot wrap a key: {error!r}") from error
        return nonce + sealed

    def unwrap(self, wrapped: bytes, context: bytes) -> bytes:
        """See `Master.unwrap`.

        Raises:
            PrivacyError: See there.
        """
        parameters = _parameters(wrapped[:NONCE_BYTES], context)
        try:
            with self._lock:
                data: bytes = self._key.decrypt(
                    wrapped[NONCE_BYTES:],
                    mechanism=Mechanism.AES_GCM,
                    mechanism_param=parameters,
                )
        except pkcs11.PKCS11Error as error:
            what = context.decode(errors="replace")
            raise PrivacyError(
                f"{what} was not wrapped by token {self._token!r}: {error!r}"
            ) from error
        return data

    def _find(self) -> Any:
        wanted = {
            pkcs11.Attribute.CLASS: pkcs11.ObjectClass.SECRET_KEY,
            pkcs11.Attribute.LABEL: LABEL,
        }
        return next(iter(self._session.get_objects(wanted)), None)

    def _make(self) -> Any:
        template = {pkcs11.Attribute.SENSITIVE: True, pkcs11.Attribute.EXTRACTABLE: False}
        return self._session.generate_key(
            KeyType.AES, 256, label=LABEL, store=True, template=template
        )


def _sign_in(token: pkcs11.Token, pin: str) -> pkcs11.Session:
    """A session; a process signs in to a token once, whatever it opens there."""
    try:
        return token.open(user_pin=pin, rw=True)
    except pkcs11.UserAlreadyLoggedIn:
        return token.open(rw=True)


def _parameters(nonce: bytes, context: bytes) -> GCMParams:
    return GCMParams(nonce, aad=context, tag_bits=128)
