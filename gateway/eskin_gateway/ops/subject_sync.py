"""The thread that sees to erasure: here at once, and at the cloud as soon as it answers."""

from __future__ import annotations

import logging
import math
from threading import Event, Thread
from typing import TYPE_CHECKING, Final

from eskin.errors import CloudError, NoKeyError, PrivacyError, SpoolError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from eskin.privacy import KeyStore, Tombstone
    from eskin_gateway.backoff import Backoff
    from eskin_gateway.ingest.biometric import BiometricEncryptor
    from eskin_gateway.spool.subject_assignments import SubjectAssignments
    from eskin_gateway.upstream.certificates_client import Certificates
    from eskin_gateway.upstream.subjects_client import Notices

log = logging.getLogger(__name__)

_TICK_S: Final = 1.0
_MOST_AT_ONCE: Final = 1000


class SubjectSync:
    """Tells the cloud who wore what, gives it keys if it may have them, has them destroyed.

    All that is left to tell can be read from the key store, so that nothing is forgotten when the
    gateway ends: each start tells of all who wore a node, also of those who wear it no more, as
    their data may be there or come yet; an erasure is told again until the cloud confirms it.

    Args:
        keystore: The site's key store.
        assignments: Who wears what.
        encryptor: Holds keys derived from the subjects'.
        subjects_client: The way to the cloud.
        certificates: Has the cloud know the nodes.
        share: Whether the cloud may have the keys.
        backoff: Between failures.
    """

    def __init__(
        self,
        keystore: KeyStore,
        assignments: SubjectAssignments,
        *,
        encryptor: BiometricEncryptor,
        subjects_client: Notices,
        certificates: Certificates,
        share: bool,
        backoff: Backoff,
    ) -> None:
        self._keystore = keystore
        self._assignments = assignments
        self._encryptor = encryptor
        self._subjects_client = subjects_client
        self._certificates = certificates
        self._share = share
        self._backoff = backoff
        self._told: set[tuple[str, str]] = set()
        self._forgotten: set[str] = set()
        self._unread: set[str] = set()
        self._stopping = Event()
        self.fault: str | None = None
        self._thread = Thread(target=self._run, name="steward", daemon=True)

    def start(self) -> None:
        """Work in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        wait = _TICK_S
        while not self._stopping.wait(wait):
            try:
                self.tend()
            except (CloudError, PrivacyError, SpoolError, OSError) as error:
                patience = error.retry_after if isinstance(error, CloudError) else None
                wait = self._backoff.failed(at_least=patience)
                if self.fault is None:
                    log.warning("subjects: %s; trying again", error)
                self.fault = str(error)
            except Exception as error:  # erasures are tried again, whatever it was
                wait = self._backoff.failed()
                if self.fault is None:
                    log.exception("subjects: it broke; trying again")
                self.fault = f"it broke: {type(error).__name__}"
            else:
                self._backoff.succeeded()
                wait, self.fault = _TICK_S, None

    @property
    def pending(self) -> float:
        """Erasures that the cloud has not confirmed; NaN where the key store cannot be read."""
        try:
            return sum(tombstone.confirmed is None for tombstone in self._keystore.graves())
        except (PrivacyError, OSError):
            return math.nan

    def tend(self) -> None:
        """Look once for what is erased or new, and tell the cloud: erasures first.

        Whose key cannot be read is told later, once it can be.

        Raises:
            CloudError: The cloud did not answer as agreed.
            PrivacyError: The key store cannot be read or written.
            SpoolError: The spool cannot be read.
        """
        self._keystore.finish()
        graves = self._keystore.graves()
        for pseudonym in {tombstone.pseudonym for tombstone in graves} - self._forgotten:
            self._encryptor.forget(pseudonym)
            self._forgotten.add(pseudonym)
        # Before anything that a file of somebody else could hinder.
        pending = [tombstone for tombstone in graves if tombstone.confirmed is None]
        for begin in range(0, len(pending), _MOST_AT_ONCE):
            self._tell_erased(pending[begin : begin + _MOST_AT_ONCE])
        worn = list(self._untold())
        for begin in range(0, len(worn), _MOST_AT_ONCE):
            self._tell_worn(worn[begin : begin + _MOST_AT_ONCE])

    def _tell_worn(self, worn: Sequence[tuple[str, str, bytes | None]]) -> None:
        results = self._subjects_client.send(worn, [])
        unknown = {node for subject, node, _ in worn if results.get(subject) == "unknown_node"}
        for subject, node, _ in worn:
            if node not in unknown:
                self._told.add((node, subject))
            # A key store from a backup brings the key back; the cloud remembers the erasure.
            if results.get(subject) == "erased" and self._keystore.bury(subject):
                log.warning("key destroyed again, as the cloud says: subject=%s", subject)
            if results.get(subject) == "conflict":
                log.error("subject's key differs from the cloud's: subject=%s", subject)
        refused = self._certificates.present(unknown) if unknown else {}
        if refused:
            node, reason = next(iter(refused.items()))
            raise CloudError(f"the cloud refuses the certificate of {node}: {reason}")

    def _tell_erased(self, pending: Sequence[Tombstone]) -> None:
        results = self._subjects_client.send([], [tombstone.pseudonym for tombstone in pending])
        for tombstone in pending:
            if results.get(tombstone.pseudonym) == "erased":
                self._keystore.confirm(tombstone)
                log.info("erasure confirmed by the cloud: subject=%s", tombstone.pseudonym)

    def _untold(self) -> Iterator[tuple[str, str, bytes | None]]:
        for node, pseudonym in self._assignments.worn():
            if (node, pseudonym) in self._told or not self._certificates.has(node):
                continue  # of a node that was never heard there is nothing
            try:
                key = self._key(pseudonym)
            except NoKeyError:  # of whom is erased, the erasure is all that is told
                continue
            except PrivacyError as error:  # the others' keys are good
                if pseudonym not in self._unread:
                    log.warning("subject is not told, trying again: reason=%s", error)
                self._unread.add(pseudonym)
            else:
                self._unread.discard(pseudonym)
                yield pseudonym, node, key

    def _key(self, pseudonym: str) -> bytes | None:
        """What the cloud is given of a subject's key."""
        if not self._share:
            self._keystore.require(pseudonym)
            return None
        return self._keystore.find(pseudonym).key
