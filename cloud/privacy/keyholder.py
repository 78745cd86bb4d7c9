"""The cloud's own copies of subjects' keys, where it was given any, and who may have them used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cloud.access import Scope
from cloud.problems import ProblemError
from cloud.store.entry import Entry
from cloud.store.events import peak_row
from eskin.errors import NoKeyError, PrivacyError
from eskin.messages import Block
from eskin.privacy import Unveiler, Veiled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from eskin.privacy import Vault


class Keyholder:
    """Opens what is sealed, for those who may.

    Args:
        vault: The cloud's key store; ``None`` where it holds no keys.

    Attributes:
        vault: The same.
    """

    def __init__(self, vault: Vault | None) -> None:
        self.vault = vault
        self._unveiler = None if vault is None else Unveiler(vault)

    def may(self, scopes: Iterable[Scope]) -> bool:
        """Whether somebody is shown what tells of a person."""
        return self._unveiler is not None and Scope.BIOMETRIC in scopes

    def reader(self, scopes: Iterable[Scope]) -> Unveiler:
        """What opens sealed messages.

        Raises:
            ProblemError: 403 without the scope, or where this cloud holds no keys.
        """
        if Scope.BIOMETRIC not in scopes:
            raise ProblemError(
                403,
                "this channel tells of a person, and this token lacks the scope "
                f"{Scope.BIOMETRIC}; ask for one that has it",
            )
        if self._unveiler is None:
            raise ProblemError(
                403,
                "this channel tells of a person, and this cloud holds no keys to read it; its "
                "site does (keys.directory here, and keys.share at the gateway, would change that)",
            )
        return self._unveiler

    def keep(self, pseudonym: str, key: bytes | None) -> str:
        """Keep a copy of a subject's key; gives ``kept``, ``declined`` or ``erased``.

        Raises:
            PrivacyError: It cannot be written.
        """
        if self.vault is None or key is None:
            return "declined"
        try:
            self.vault.keep(pseudonym, key)
        except NoKeyError:
            return "erased"
        return "kept"

    def erase(self, pseudonym: str) -> None:
        """Destroy the copy of a subject's key, for good, also where there never was one.

        Raises:
            PrivacyError: It cannot be destroyed.
        """
        if self.vault is not None and self._unveiler is not None:
            self.vault.bury(pseudonym)
            self._unveiler.forget(pseudonym)

    def reveal(self, scopes: Iterable[Scope]) -> Callable[[Entry], Entry | None]:
        """What the live feed's entries look like to somebody; ``None`` for what is not shown."""
        unveiler = self._unveiler if self.may(scopes) else None

        def revealed(entry: Entry) -> Entry | None:
            if entry.veiled is None:
                return entry
            return None if unveiler is None else _open(unveiler, entry, entry.veiled)

        return revealed


def _open(unveiler: Unveiler, entry: Entry, sealed: bytes) -> Entry | None:
    try:
        message, data = unveiler.read(entry.node, Veiled.decode(sealed))
    except PrivacyError:  # erased since, or never given
        return None
    if isinstance(message, Block):
        return Entry(entry.cursor, entry.node, entry.channel, data, None)
    row = peak_row(entry.node, message, data) | {"cursor": entry.cursor}
    return Entry(entry.cursor, entry.node, entry.channel, None, row)
