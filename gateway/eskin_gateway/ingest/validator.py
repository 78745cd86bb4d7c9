"""From sealed arrivals to one batch that can become durable."""

from __future__ import annotations

import logging
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from eskin.errors import (
    EskinError,
    ForgedEnvelopeError,
    MalformedEnvelopeError,
    MessageError,
    PrivacyError,
    SpoolError,
    UnknownRecipientError,
    UnknownSenderError,
    UntrustedCertificateError,
)
from eskin.wire.envelope import MOST_ENVELOPE, Opened, introduction
from eskin.wire.messages import (
    BlockSummary,
    Gap,
    Peak,
    Position,
    Result,
    Status,
    Summary,
    decode_summary,
)
from eskin.wire.topics import FROM_NODE, Stream, parse_node_topic
from eskin_gateway.ingest.unreadable import poison_position
from eskin_gateway.reject_reason import RejectReason
from eskin_gateway.spool.batch import Batch, DeadLetter, Entry

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.wire.envelope import Opener
    from eskin_gateway.ingest.biometric import BiometricEncryptor
    from eskin_gateway.mqtt.received_message import ReceivedMessage
    from eskin_gateway.spool.node_certificates import NodeCertificates
    from eskin_gateway.spool.node_states import NodeStates

log = logging.getLogger(__name__)

_LONGEST_TOPIC: Final = 200
_FITS: Final = {
    Stream.BLOCKS: (BlockSummary,),
    Stream.EVENTS: (Peak, Gap, Result),
    Stream.STATUS: (Status,),
}
_REASONS: Final = (
    (MalformedEnvelopeError, RejectReason.MALFORMED),
    (UnknownRecipientError, RejectReason.WRONG_RECIPIENT),
    (UnknownSenderError, RejectReason.UNKNOWN_SENDER),
    (UntrustedCertificateError, RejectReason.UNTRUSTED),
    (ForgedEnvelopeError, RejectReason.FORGED),
    (PrivacyError, RejectReason.FAULT),
    (SpoolError, RejectReason.FAULT),
)


@dataclass(slots=True)
class IngestResult:
    """What a batch of arrivals came to.

    Attributes:
        batch: What must become durable.
        positions: What to acknowledge to each node, once it is durable.
        messages: What to publish, once it is durable: node, message, whether it is fresh.
        duplicates: How many had been accepted before.
        rejected: How many were refused, by reason.
    """

    batch: Batch = field(default_factory=Batch)
    positions: dict[str, list[Position]] = field(default_factory=dict)
    messages: list[tuple[str, Summary, bool]] = field(default_factory=list)
    duplicates: int = 0
    rejected: Counter[RejectReason] = field(default_factory=Counter)


class Validator:
    """Authenticates, decodes and sorts arrivals. Only for one thread.

    Args:
        opener: Opens envelopes.
        node_certificates: Certificates of nodes.
        records: What was accepted before.
        encryptor: Seals what tells of a person.
        now: UTC ns.
    """

    def __init__(
        self,
        *,
        opener: Opener,
        node_certificates: NodeCertificates,
        records: NodeStates,
        encryptor: BiometricEncryptor,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        self._opener = opener
        self._node_certificates = node_certificates
        self._records = records
        self._encryptor = encryptor
        self._now = now

    def sort(self, received_messages: Sequence[ReceivedMessage]) -> IngestResult:
        """Judge arrivals, in order. What was accepted counts as known only once committed.

        What one node's key or record hinders is not acknowledged to it, and hinders no other.
        """
        self._node_certificates.refresh()
        outcome = IngestResult()
        received = self._now()
        for received_message in received_messages:
            try:
                node, stream = _address(received_message)
                opened = self._open(received_message, node, stream)
            except EskinError as error:
                self._reject(outcome, received_message, _reason(error, received_message), error)
                continue
            if opened.sender != node:
                claim = MessageError(f"sealed by {opened.sender!r}")
                self._reject(outcome, received_message, RejectReason.MISADDRESSED, claim)
                continue
            try:
                self._accept(outcome, received_message, node, stream, opened, received)
            except (PrivacyError, SpoolError) as error:  # the others' keys and records are good
                self._reject(outcome, received_message, RejectReason.FAULT, error)
        outcome.batch.node_certificates = self._node_certificates.fresh()
        return outcome

    def committed(self, batch: Batch) -> None:
        """A batch is durable now, and so is what it taught."""
        self._node_certificates.remembered()
        self._records.committed(batch.nodes)

    def forget(self) -> None:
        """A batch failed: memory may know positions that never became durable."""
        self._records.forget()

    def _open(self, received_message: ReceivedMessage, node: str, stream: Stream) -> Opened:
        if stream is Stream.STATUS:
            chain = introduction(received_message.payload)
            if chain is not None:
                self._node_certificates.introduce(chain, node)
        return self._opener.open(received_message.payload, topic=received_message.topic)

    def _accept(
        self,
        outcome: IngestResult,
        received_message: ReceivedMessage,
        node: str,
        stream: Stream,
        opened: Opened,
        received: int,
    ) -> None:
        record = self._records[node]
        outcome.batch.nodes[node] = record
        record.thumbprint = opened.thumbprint
        try:
            message = decode_summary(opened.plaintext)
            if not isinstance(message, _FITS[stream]):
                raise MessageError(f"a message of its kind has no place among the {stream}")
            personal = self._encryptor.read(message, opened.plaintext)
        except EskinError as error:
            self._bury(outcome, received_message, node, opened, str(error))
            return
        position = message.position
        if record.seen(position):
            outcome.duplicates += 1
        else:
            body = self._encryptor.guard(node, personal, opened.plaintext)
            record.add(position)
            outcome.batch.entries.append(Entry(node, received, body, *position))
            # It may have been said long ago, and be forgotten here: the cloud knows.
            if position.boot >= record.held.boot:
                outcome.messages.append((node, message, not received_message.retained))
                if isinstance(message, Status):
                    record.status = opened.plaintext
        outcome.positions.setdefault(node, []).append(position)
        record.release(opened.held)

    def _bury(
        self,
        outcome: IngestResult,
        received_message: ReceivedMessage,
        node: str,
        opened: Opened,
        why: str,
    ) -> None:
        """An authentic message that nobody can read: kept aside, and acknowledged."""
        record = self._records[node]
        position = poison_position(opened.plaintext)
        if position is not None and record.seen(position):
            outcome.positions.setdefault(node, []).append(position)
            outcome.duplicates += 1
            return
        letter = DeadLetter(self._now(), node, why, opened.plaintext)
        letter = self._encryptor.guard_unread(letter, position)
        if position is not None:
            outcome.positions.setdefault(node, []).append(position)
            record.add(position)
        outcome.batch.dead.append(letter)
        self._reject(outcome, received_message, RejectReason.POISON, MessageError(letter.reason))

    def _reject(
        self,
        outcome: IngestResult,
        received_message: ReceivedMessage,
        reason: RejectReason,
        error: EskinError,
    ) -> None:
        outcome.rejected[reason] += 1
        log.warning(
            "message rejected: reason=%s topic=%r error=%s",
            reason,
            received_message.topic[:_LONGEST_TOPIC],
            error,
            extra={"source": reason},
        )


def _address(received_message: ReceivedMessage) -> tuple[str, Stream]:
    if len(received_message.payload) > MOST_ENVELOPE:
        raise MessageError(
            f"message of {len(received_message.payload)} bytes; at most {MOST_ENVELOPE} are allowed"
        )
    node, stream = parse_node_topic(received_message.topic)
    if stream not in FROM_NODE:
        raise MessageError(f"nodes do not write {stream}")
    return node, stream


def _reason(error: EskinError, received_message: ReceivedMessage) -> RejectReason:
    for kind, reason in _REASONS:
        if isinstance(error, kind):
            return reason
    return (
        RejectReason.OVERSIZED
        if len(received_message.payload) > MOST_ENVELOPE
        else RejectReason.TOPIC
    )
