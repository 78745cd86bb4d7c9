"""The thread that sends subjects' keys and erasures to the cloud."""

from __future__ import annotations

import logging
import math
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from eskin.errors import CloudError, NoKeyError, PrivacyError
from eskin.runtime.supervised import Supervised

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from eskin.privacy import KeyStore, Tombstone
    from eskin.runtime.supervised import Backoff
    from eskin_gateway.ingest.biometric import BiometricEncryptor
    from eskin_gateway.spool.subject_assignments import SubjectAssignments
    from eskin_gateway.upstream.certificates_client import CertificatesClient
    from eskin_gateway.upstream.subjects_client import SubjectsClient

log = logging.getLogger(__name__)

_POLL_S: Final = 1.0
_MAX_SUBJECTS: Final = 1000


class SubjectSync:
    """Synchronises subjects with the cloud.

    The key store holds all that is needed, so nothing is lost when the gateway ends: each start
    sends all subjects that ever wore a node, because their data may be in the cloud or still come.
    An erasure is sent again until the cloud confirms it.

    Args:
        keystore: The site's key store.
        assignments: Subjects by node.
        encryptor: Holds keys derived from the subjects' keys.
        subjects_client: Sends subjects to the cloud.
        certificates_client: Registers nodes at the cloud.
        share: Whether the cloud gets the keys.
        backoff: Delays after failures.
    """

    def __init__(
        self,
        keystore: KeyStore,
        assignments: SubjectAssignments,
        *,
        encryptor: BiometricEncryptor,
        subjects_client: SubjectsClient,
        certificates_client: CertificatesClient,
        share: bool,
        backoff: Backoff,
    ) -> None:
        self._keystore = keystore
        self._assignments = assignments
        self._encryptor = encryptor
        self._subjects_client = subjects_client
        self._certificates_client = certificates_client
        self._share = share
        self._sent: set[tuple[str, str]] = set()
        self._forgotten: set[str] = set()
        self._unreadable: set[str] = set()
        self._late: int | None = None
        self._thread = Supervised("subject_sync", self._step, backoff=backoff, idle_s=_POLL_S)

    @property
    def fault(self) -> str | None:
        """Why subjects cannot be synchronised."""
        return self._thread.fault

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._thread.stop()

    def _step(self) -> bool:
        self.sync()
        self._thread.succeeded()
        return False

    @property
    def pending(self) -> float:
        """Erasures that the cloud has not confirmed; NaN if the key store cannot be read."""
        try:
            return sum(tombstone.confirmed is None for tombstone in self._keystore.tombstones())
        except (PrivacyError, OSError):
            return math.nan

    def sync(self) -> None:
        """Send what is erased or new, erasures first.

        Raises:
            CloudError: The request failed.
            PrivacyError: The key store cannot be read or written.
            SpoolError: The spool cannot be read.
        """
        self._keystore.finish()
        tombstones = self._keystore.tombstones()
        for pseudonym in {tombstone.pseudonym for tombstone in tombstones} - self._forgotten:
            self._encryptor.forget(pseudonym)
            self._forgotten.add(pseudonym)
        # Erasures come first, because a damaged file of another subject may end this run.
        self._send_pending(tombstones)
        unsent = list(self._unsent())
        for begin in range(0, len(unsent), _MAX_SUBJECTS):
            self._send_assignments(unsent[begin : begin + _MAX_SUBJECTS])

    def confirm_erasures(self) -> None:
        """Have the cloud confirm erasures before it gets late data of the erased subjects.

        Each gateway encrypts late data under a random key of its own. A cloud that does not know of
        the erasure would take two copies of a message for two messages under one number. At a
        start, the spool may hold such data. Called by the forwarder's thread.

        A key store that cannot be read holds up no data; `fault` names it.

        Raises:
            CloudError: The request failed.
        """
        late = self._assignments.erased
        if late != self._late:
            with suppress(PrivacyError):
                self._send_pending(self._keystore.tombstones())
                self._late = late

    def _send_pending(self, tombstones: Sequence[Tombstone]) -> None:
        pending = [tombstone for tombstone in tombstones if tombstone.confirmed is None]
        for begin in range(0, len(pending), _MAX_SUBJECTS):
            self._send_erasures(pending[begin : begin + _MAX_SUBJECTS])

    def _send_assignments(self, assigned: Sequence[tuple[str, str, bytes | None]]) -> None:
        results = self._subjects_client.send(assigned, [])
        unknown = {node for subject, node, _ in assigned if results.get(subject) == "unknown_node"}
        for subject, node, _ in assigned:
            if node not in unknown:
                self._sent.add((node, subject))
            # A key store from a backup restores the key, but the cloud remembers the erasure.
            if results.get(subject) == "erased" and self._keystore.shred(subject):
                log.warning("key destroyed again: subject=%s", subject)
            if results.get(subject) == "conflict":
                log.error("subject's key differs from the cloud's: subject=%s", subject)
        rejected = self._certificates_client.register(unknown) if unknown else {}
        if rejected:
            node, reason = next(iter(rejected.items()))
            raise CloudError(f"the cloud rejects the certificate of {node}: {reason}")

    def _send_erasures(self, pending: Sequence[Tombstone]) -> None:
        results = self._subjects_client.send([], [tombstone.pseudonym for tombstone in pending])
        for tombstone in pending:
            if results.get(tombstone.pseudonym) == "erased":
                self._keystore.confirm(tombstone)
                log.info("erasure confirmed by the cloud: subject=%s", tombstone.pseudonym)

    def _unsent(self) -> Iterator[tuple[str, str, bytes | None]]:
        for node, pseudonym in self._assignments.all_wearers():
            if (node, pseudonym) in self._sent or not self._certificates_client.has(node):
                continue  # without a certificate there are no data of the node
            try:
                key = self._key(pseudonym)
            except NoKeyError:  # erased: only the erasure is sent
                continue
            except PrivacyError as error:  # other subjects' keys can be read
                if pseudonym not in self._unreadable:
                    log.warning("subject not sent, retrying: error=%s", error)
                self._unreadable.add(pseudonym)
            else:
                self._unreadable.discard(pseudonym)
                yield pseudonym, node, key

    def _key(self, pseudonym: str) -> bytes | None:
        """A subject's key, if the cloud may have it."""
        if not self._share:
            self._keystore.require(pseudonym)
            return None
        return self._keystore.find(pseudonym).key
