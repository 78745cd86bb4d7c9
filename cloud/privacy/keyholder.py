"""The cloud's own copies of subjects' keys, where it was given any, and who may have them used."""

from __future__ import annotations

import logging
import time
from threading import Lock
from typing import TYPE_CHECKING, Final

from cloud.access import Scope
from cloud.privacy.erasures import unheard
from cloud.privacy.errors import ErasedError
from cloud.problems import ProblemError
from cloud.store.events import peak_row
from eskin.errors import NoKeyError, PrivacyError, StoreError
from eskin.messages import Block
from eskin.privacy import Unveiler, Veiled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from sqlalchemy import Connection

    from cloud.store.entry import Entry
    from eskin.messages import Peak
    from eskin.privacy import Vault

log = logging.getLogger(__name__)

_DEAF_S: Final = 10.0
"""After so long without a look at the store's erasures, the live feed is told nothing sealed."""


class Reader:
    """Opens sealed messages for one request, and notes whose.

    Args:
        unveiler: Opens them.
        opened: Takes the subjects; the request's answer ends when one of them is erased.
    """

    def __init__(self, unveiler: Unveiler, opened: set[str]) -> None:
        self._unveiler = unveiler
        self._opened = opened

    def read(self, node: str, veiled: Veiled) -> tuple[Block | Peak, bytes]:
        """As `Unveiler.read`."""
        found = self._unveiler.read(node, veiled)
        self._opened.add(veiled.subject)
        return found


class Keyholder:
    """Opens what is sealed, for those who may.

    Of several clouds on one store each may have a key store of its own, and an erasure is told to
    one of them: so each question, and each second, is begun by a look at the store's erasures.

    Args:
        vault: The cloud's key store; ``None`` where it holds no keys.

    Attributes:
        vault: The same.
    """

    def __init__(self, vault: Vault | None) -> None:
        self.vault = vault
        self._unveiler = None if vault is None else Unveiler(vault)
        self._heard: set[str] = set()
        self._hearing = Lock()
        self._looked: float | None = None

    def may(self, scopes: Iterable[Scope]) -> bool:
        """Whether somebody is shown what tells of a person."""
        return self._unveiler is not None and Scope.BIOMETRIC in scopes

    def reader(self, scopes: Iterable[Scope], connection: Connection, opened: set[str]) -> Reader:
        """What opens sealed messages of whoever is not erased.

        Args:
            scopes: Of the one who asks.
            opened: Takes the subjects whose messages are opened.
            connection: Reads the store that the question is asked of.

        Raises:
            ProblemError: 403 without the scope, or where this cloud holds no keys.
            PrivacyError: The key of an erased subject cannot be destroyed.
        """
        unveiler = self.require(scopes)
        self.heed(connection)
        return Reader(unveiler, opened)

    def require(self, scopes: Iterable[Scope]) -> Unveiler:
        """Refuse whoever may not be shown what tells of a person.

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

    def erase(self, pseudonym: str) -> bool:
        """Destroy the copy of a subject's key, for good, also where there never was one.

        Returns:
            Whether it is new here that it was erased.

        Raises:
            PrivacyError: It cannot be destroyed.
        """
        if self.vault is None or self._unveiler is None:
            return False
        new = self.vault.bury(pseudonym)
        self._unveiler.forget(pseudonym)
        return new

    def heed(self, connection: Connection) -> None:
        """Destroy copies of keys of whom the store says that they are erased.

        Raises:
            PrivacyError: One cannot be destroyed.
        """
        if self.vault is None:
            return
        begun = time.monotonic()
        with self._hearing:
            for subject in unheard(connection, self._heard):
                if self.erase(subject):
                    log.info("erased, as another cloud was told: subject=%s", subject)
                self._heard.add(subject)
            self._looked = begun

    def require_unerased(self, connection: Connection, subjects: Iterable[str]) -> None:
        """Check that none of the subjects was erased, here or at another cloud on this store.

        Raises:
            ErasedError: One was.
            PrivacyError: The key of an erased subject cannot be destroyed.
        """
        self.heed(connection)
        if self.vault is not None:
            for subject in subjects:
                try:
                    self.vault.require(subject)
                except NoKeyError as error:
                    raise ErasedError(error) from error

    def reveal(self, scopes: Iterable[Scope]) -> Callable[[Entry], Entry | None]:
        """What the live feed's entries look like to somebody; ``None`` for what is not shown.

        It raises StoreError where nobody has looked for erasures for long: see `hear`.
        """
        unveiler = self._unveiler if self.may(scopes) else None

        def revealed(entry: Entry) -> Entry | None:
            if entry.veiled is None:
                return entry
            if unveiler is None:
                return None
            self._require_hearing()
            return _open(unveiler, entry, entry.veiled)

        return revealed

    def _require_hearing(self) -> None:
        # The feed is told on the loop, where nobody may wait for the store.
        if self._looked is None or time.monotonic() - self._looked > _DEAF_S:
            raise StoreError(f"whom other clouds erased was not heard for {_DEAF_S:.0f} s")


def _open(unveiler: Unveiler, entry: Entry, sealed: bytes) -> Entry | None:
    try:
        message, data = unveiler.read(entry.node, Veiled.decode(sealed))
    except PrivacyError:  # erased since, or never given
        return None
    if isinstance(message, Block):
        return entry._replace(block=data, veiled=None)
    row = peak_row(entry.node, message, data) | {"cursor": entry.cursor}
    return entry._replace(event=row, veiled=None)
