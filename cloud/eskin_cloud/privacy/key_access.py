"""The cloud's copies of subjects' keys, and who may use them."""

from __future__ import annotations

import logging
import time
from threading import Lock
from typing import TYPE_CHECKING, Final, Self

from sqlalchemy import func, select

from eskin.errors import KeyConflictError, NoKeyError, PrivacyError, StoreError
from eskin.identity import IdentityKind
from eskin.privacy import Decryptor
from eskin_cloud.access import Scope
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.sealed_tables import erased_subjects
from eskin_cloud.store.schema.tables import node_sites

if TYPE_CHECKING:
    from collections.abc import Iterable
    from collections.abc import Set as AbstractSet

    from sqlalchemy import Connection

    from eskin.privacy import KeyStore, SealedMessage
    from eskin.privacy.cipher import Sealable

log = logging.getLogger(__name__)

_COUNT: Final = select(func.count()).select_from(node_sites)
_ERASURES_AGE_S: Final = 10.0
"""After so long without a look at erasures, the live feed sends nothing sealed."""


class BiometricAccessError(PrivacyError):
    """The caller may not read biometric channels here."""


class ErasedError(PrivacyError):
    """All that was asked for is of subjects whose keys are not here."""

    def __init__(self, cause: NoKeyError) -> None:
        super().__init__(f"nothing of this window can be read: {cause}")
        self.erased = cause.erased


def _unapplied_erasures(
    connection: Connection, known: AbstractSet[tuple[str, str]]
) -> set[tuple[str, str]]:
    """Erased subjects, each with its site, that are not known; the store forgets none."""
    counted = select(func.count()).select_from(erased_subjects)
    if connection.execute(counted).scalar_one() <= len(known):
        return set()
    rows = connection.execute(select(erased_subjects)).mappings()
    found = intact_rows(connection, erased_subjects, rows)
    return {(row["site"], row["subject"]) for row in found} - known


class RequestReader:
    """Opens sealed messages for one request, and notes whose.

    Args:
        key_access: Opens them.
        opened: Takes sites and subjects; the request's answer ends when one of them is erased.
    """

    def __init__(self, key_access: KeyAccess, opened: set[tuple[str, str]]) -> None:
        self._key_access = key_access
        self._opened = opened

    def read(self, node: str, sealed: SealedMessage, /) -> tuple[Sealable, bytes]:
        """As `Decryptor.read`."""
        found = self._key_access.read(node, sealed)
        self._opened.add((self._key_access.site_of(node), sealed.subject))
        return found


class KeyAccess:
    """Decrypts sealed messages for permitted callers.

    Of several clouds on one store each may have a key store of its own, and one of
    them receives an erasure: so each query, and each second, begins with a look at the store's.

    Args:
        keystore: The cloud's key store; ``None`` where it holds no keys.

    Attributes:
        keystore: The same.
    """

    def __init__(self, keystore: KeyStore | None) -> None:
        self.keystore = keystore
        self._sites: dict[str, str] = {}
        self._held: dict[str, tuple[KeyStore, Decryptor]] = {}
        self._opening = Lock()
        self._applied: set[tuple[str, str]] = set()
        self._applying = Lock()
        self._applied_at: float | None = None

    def of(self, site: str) -> KeyStore:
        """The key store of a site: its subjects are others than another site's of the same name.

        Raises:
            PrivacyError: It cannot be used, or this cloud holds no keys.
        """
        return self._open(site)[0]

    def read(self, node: str, sealed: SealedMessage, /) -> tuple[Sealable, bytes]:
        """What was sealed, by the key that its node's site gave; see `Decryptor.read`.

        Raises:
            PrivacyError: It cannot be read.
        """
        site = self.site_of(node)
        if not site or self.keystore is None:
            raise NoKeyError(sealed.subject, erased=False)
        return self._open(site)[1].read(node, sealed)

    def site_of(self, node: str) -> str:
        """A node's site, as far as it is known; else empty."""
        return self._sites.get(node, "")

    def _open(self, site: str) -> tuple[KeyStore, Decryptor]:
        if self.keystore is None:
            raise PrivacyError("this cloud holds no keys")
        with self._opening:
            if site not in self._held:
                keystore = self.keystore.below(f"sites/{IdentityKind.SITE.require_name(site)}")
                self._held[site] = keystore, Decryptor(keystore)
            return self._held[site]

    def may(self, scopes: Iterable[Scope]) -> bool:
        """Whether a caller may read biometric data here."""
        return self.keystore is not None and Scope.BIOMETRIC in scopes

    def reader(
        self, scopes: Iterable[Scope], connection: Connection, opened: set[tuple[str, str]]
    ) -> RequestReader:
        """A reader of sealed messages of subjects that are not erased.

        Args:
            scopes: Of the one who asks.
            opened: Takes the subjects whose messages are opened.
            connection: Reads the store that the question is asked of.

        Raises:
            BiometricAccessError: The scope is missing, or this cloud holds no keys.
            PrivacyError: The key of an erased subject cannot be destroyed.
        """
        self.require(scopes)
        self.apply_erasures(connection)
        return RequestReader(self, opened)

    def require(self, scopes: Iterable[Scope]) -> Self:
        """Refuse a caller who may not read biometric data.

        Raises:
            BiometricAccessError: The scope is missing, or this cloud holds no keys.
        """
        if Scope.BIOMETRIC not in scopes:
            raise BiometricAccessError(
                f"this channel is biometric, and this token lacks the scope {Scope.BIOMETRIC}; "
                "ask for one that has it"
            )
        if self.keystore is None:
            raise BiometricAccessError(
                "this channel is biometric, and this cloud holds no keys to read it; its site does "
                "(set keys.directory here and keys.share at the gateway to change that)"
            )
        return self

    def keep(self, site: str, pseudonym: str, key: bytes | None) -> str:
        """Keep a copy of a subject's key; gives ``kept``, ``declined``, ``erased`` or ``conflict``.

        Raises:
            PrivacyError: It cannot be written.
        """
        if self.keystore is None or key is None:
            return "declined"
        try:
            self.of(site).keep(pseudonym, key)
        except NoKeyError:
            return "erased"
        except KeyConflictError as error:
            log.error("subject's key differs: site=%s reason=%s", site, error)  # noqa: TRY400 - no fault of ours
            return "conflict"
        return "kept"

    def erase(self, site: str, pseudonym: str) -> bool:
        """Destroy the copy of a subject's key, also where there never was one.

        Returns:
            Whether it is new here that it was erased.

        Raises:
            PrivacyError: It cannot be destroyed.
        """
        if self.keystore is None:
            return False
        keystore, decryptor = self._open(site)
        new = keystore.shred(pseudonym)
        decryptor.forget(pseudonym)
        return new

    def apply_erasures(self, connection: Connection) -> None:
        """Destroy the keys of subjects that the store says are erased.

        Raises:
            PrivacyError: One cannot be destroyed.
        """
        if self.keystore is None:
            return
        begun = time.monotonic()
        with self._applying:
            if connection.execute(_COUNT).scalar_one() != len(self._sites):
                rows = connection.execute(select(node_sites)).mappings()
                intact = intact_rows(connection, node_sites, rows)
                self._sites = {row["node"]: row["site"] for row in intact}
            for site, subject in _unapplied_erasures(connection, self._applied):
                if self.erase(site, subject):
                    log.info("erasure of another cloud applied: site=%s subject=%s", site, subject)
                self._applied.add((site, subject))
            self._applied_at = begun

    def require_unerased(self, connection: Connection, subjects: Iterable[tuple[str, str]]) -> None:
        """Check that none of some subjects, each with its site, was erased, here or elsewhere.

        Raises:
            ErasedError: One was.
            PrivacyError: The key of an erased subject cannot be destroyed.
        """
        self.apply_erasures(connection)
        if self.keystore is not None:
            for site, subject in subjects:
                try:
                    self.of(site).require(subject)
                except NoKeyError as error:
                    raise ErasedError(error) from error

    def require_fresh_erasures(self) -> None:
        """Check that the store's erasures were looked for lately.

        Raises:
            StoreError: They were not.
        """
        # The feed runs on the event loop, which must not wait for the store.
        if self._applied_at is None or time.monotonic() - self._applied_at > _ERASURES_AGE_S:
            raise StoreError(f"erasures of other clouds were not read for {_ERASURES_AGE_S:.0f} s")
