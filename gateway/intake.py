"""From sealed arrivals to one batch that can become durable."""

from __future__ import annotations

import logging
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from eskin.envelope import MOST_ENVELOPE, Opened, introduction
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
from eskin.messages import (
    BlockSummary,
    Gap,
    Peak,
    Position,
    Result,
    Status,
    Summary,
    decode_summary,
)
from eskin.topics import FROM_NODE, Stream, parse_node_topic
from gateway.batch import Batch, DeadLetter, Entry
from gateway.poison import poison_position
from gateway.reason import Reason

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.envelope import Opener
    from gateway.arrival import Arrival
    from gateway.records import Records
    from gateway.senders import Senders
    from gateway.veiling import Veiling

log = logging.getLogger(__name__)

_LONGEST_TOPIC: Final = 200
_FITS: Final = {
    Stream.BLOCKS: (BlockSummary,),
    Stream.EVENTS: (Peak, Gap, Result),
    Stream.STATUS: (Status,),
}
_REASONS: Final = (
    (MalformedEnvelopeError, Reason.MALFORMED),
    (UnknownRecipientError, Reason.WRONG_RECIPIENT),
    (UnknownSenderError, Reason.UNKNOWN_SENDER),
    (UntrustedCertificateError, Reason.UNTRUSTED),
    (ForgedEnvelopeError, Reason.FORGED),
    (PrivacyError, Reason.FAULT),
    (SpoolError, Reason.FAULT),
)


@dataclass(slots=True)
class Outcome:
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
    rejected: Counter[Reason] = field(default_factory=Counter)


class Intake:
    """Authenticates, decodes and sorts arrivals. Only for one thread.

    Args:
        opener: Opens envelopes.
        senders: Certificates of nodes.
        records: What was accepted before.
        veiling: Seals what tells of a person.
        now: UTC ns.
    """

    def __init__(
        self,
        *,
        opener: Opener,
        senders: Senders,
        records: Records,
        veiling: Veiling,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        self._opener = opener
        self._senders = senders
        self._records = records
        self._veiling = veiling
        self._now = now

    def sort(self, arrivals: Sequence[Arrival]) -> Outcome:
        """Judge arrivals, in order. What was accepted counts as known only once committed.

        What one node's key or record hinders is not acknowledged to it, and hinders no other.
        """
        self._senders.refresh()
        outcome = Outcome()
        received = self._now()
        for arrival in arrivals:
            try:
                node, stream = _address(arrival)
                opened = self._open(arrival, node, stream)
            except EskinError as error:
                self._reject(outcome, arrival, _reason(error, arrival), error)
                continue
            if opened.sender != node:
                claim = MessageError(f"sealed by {opened.sender!r}")
                self._reject(outcome, arrival, Reason.MISADDRESSED, claim)
                continue
            try:
                self._accept(outcome, arrival, node, stream, opened, received)
            except (PrivacyError, SpoolError) as error:  # the others' keys and records are good
                self._reject(outcome, arrival, Reason.FAULT, error)
        outcome.batch.senders = self._senders.fresh()
        return outcome

    def committed(self, batch: Batch) -> None:
        """A batch is durable now, and so is what it taught."""
        self._senders.remembered()
        self._records.committed(batch.nodes)

    def forget(self) -> None:
        """A batch failed: memory may know positions that never became durable."""
        self._records.forget()

    def _open(self, arrival: Arrival, node: str, stream: Stream) -> Opened:
        if stream is Stream.STATUS:
            chain = introduction(arrival.payload)
            if chain is not None:
                self._senders.introduce(chain, node)
        return self._opener.open(arrival.payload, topic=arrival.topic)

    def _accept(
        self,
        outcome: Outcome,
        arrival: Arrival,
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
            personal = self._veiling.read(message, opened.plaintext)
        except EskinError as error:
            self._bury(outcome, arrival, node, opened, str(error))
            return
        position = message.position
        if record.seen(position):
            outcome.duplicates += 1
        else:
            body = self._veiling.guard(node, personal, opened.plaintext)
            record.add(position)
            outcome.batch.entries.append(Entry(node, received, body, *position))
            # It may have been said long ago, and be forgotten here: the cloud knows.
            if position.boot >= record.held.boot:
                outcome.messages.append((node, message, not arrival.retained))
                if isinstance(message, Status):
                    record.status = opened.plaintext
        outcome.positions.setdefault(node, []).append(position)
        record.release(opened.held)

    def _bury(
        self, outcome: Outcome, arrival: Arrival, node: str, opened: Opened, why: str
    ) -> None:
        """An authentic message that nobody can read: kept aside, and acknowledged."""
        record = self._records[node]
        position = poison_position(opened.plaintext)
        if position is not None and record.seen(position):
            outcome.positions.setdefault(node, []).append(position)
            outcome.duplicates += 1
            return
        letter = DeadLetter(self._now(), node, why, opened.plaintext)
        letter = self._veiling.guard_unread(letter, position)
        if position is not None:
            outcome.positions.setdefault(node, []).append(position)
            record.add(position)
        outcome.batch.dead.append(letter)
        self._reject(outcome, arrival, Reason.POISON, MessageError(letter.reason))

    def _reject(
        self, outcome: Outcome, arrival: Arrival, reason: Reason, error: EskinError
    ) -> None:
        outcome.rejected[reason] += 1
        log.warning(
            "message rejected: reason=%s topic=%r error=%s",
            reason,
            arrival.topic[:_LONGEST_TOPIC],
            error,
            extra={"source": reason},
        )


def _address(arrival: Arrival) -> tuple[str, Stream]:
    if len(arrival.payload) > MOST_ENVELOPE:
        raise MessageError(
            f"message of {len(arrival.payload)} bytes; at most {MOST_ENVELOPE} are allowed"
        )
    node, stream = parse_node_topic(arrival.topic)
    if stream not in FROM_NODE:
        raise MessageError(f"nodes do not write {stream}")
    return node, stream


def _reason(error: EskinError, arrival: Arrival) -> Reason:
    for kind, reason in _REASONS:
        if isinstance(error, kind):
            return reason
    return Reason.OVERSIZED if len(arrival.payload) > MOST_ENVELOPE else Reason.TOPIC
