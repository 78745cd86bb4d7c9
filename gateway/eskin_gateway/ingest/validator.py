"""Turns received messages into one batch for the spool."""

from __future__ import annotations

import hashlib
import logging
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, TypeAlias

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
from eskin.wire.frames import DescribedLayout, EncodedFrame, Layout, Patch, Privacy, Statements
from eskin.wire.messages import Kind, Position, Result, Status
from eskin.wire.messages.cbor_map import MOST_COUNT, integer, load, load_any
from eskin.wire.topics import FROM_NODE, Stream, parse_node_topic
from eskin_gateway.metrics import RejectReason
from eskin_gateway.spool.batch import Batch, DeadLetter, SpoolMessage

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.wire.envelope import Opener
    from eskin_gateway.ingest.biometric import BiometricEncryptor
    from eskin_gateway.ingest.missing_layouts import MissingLayouts
    from eskin_gateway.mqtt.transport import ReceivedMessage
    from eskin_gateway.spool.descriptions import Descriptions
    from eskin_gateway.spool.node_certificates import NodeCertificates
    from eskin_gateway.spool.node_state import NodeStates

log = logging.getLogger(__name__)

_MAX_LOGGED_TOPIC: Final = 200
_REASONS: Final = (
    (MalformedEnvelopeError, RejectReason.MALFORMED),
    (UnknownRecipientError, RejectReason.WRONG_RECIPIENT),
    (UnknownSenderError, RejectReason.UNKNOWN_SENDER),
    (UntrustedCertificateError, RejectReason.UNTRUSTED),
    (ForgedEnvelopeError, RejectReason.FORGED),
    (PrivacyError, RejectReason.INTERNAL_ERROR),
    (SpoolError, RejectReason.INTERNAL_ERROR),
)


Described: TypeAlias = EncodedFrame | Statements
"""A message that names a layout."""

Numbered: TypeAlias = Status | Result | Described
"""A message with a position."""

_DECODERS: Final[dict[int, Callable[[bytes], Numbered | Patch | Layout]]] = {
    Kind.STATUS: Status.decode,
    Kind.RESULT: Result.decode,
    Kind.FRAME: EncodedFrame.decode,
    Kind.STATEMENTS: Statements.decode,
    Kind.PATCH: Patch.decode,
    Kind.LAYOUT: Layout.decode,
}


def decode(plaintext: bytes) -> Numbered | Patch | Layout:
    """Decode a message; a frame without its samples, which are checked.

    Raises:
        MessageError: It is none.
    """
    # Field 1, the kind, is the first of a map whose head has one byte.
    kind = plaintext[2] if len(plaintext) > 2 and plaintext[1] == 1 else 0
    decoder = _DECODERS.get(kind)
    if decoder is None:
        kind = load(plaintext).integer(1, 0, 255)
        raise MessageError(f"field 1 is {kind}; a node sends kinds {sorted(map(int, _DECODERS))}")
    return decoder(plaintext)


_MESSAGE_TYPES: Final = {
    Stream.FRAMES: (EncodedFrame,),
    Stream.LAYOUTS: (Patch, Layout),
    Stream.EVENTS: (Result, Statements),
    Stream.STATUS: (Status,),
}


@dataclass(slots=True)
class IngestResult:
    """Result of a batch of received messages.

    Attributes:
        batch: What must be committed.
        positions: What to acknowledge to each node after the commit.
        want: Hashes of the descriptions to ask each node for.
        messages: What to publish after the commit: node, message, whether it was not retained.
        duplicates: Messages that were accepted before.
        waiting: Messages that are not acknowledged, because their layout is missing.
        rejected: Rejected messages by reason.
    """

    batch: Batch = field(default_factory=Batch)
    positions: dict[str, list[Position]] = field(default_factory=dict)
    want: dict[str, dict[bytes, None]] = field(default_factory=dict)
    messages: list[tuple[str, Numbered, bool]] = field(default_factory=list)
    duplicates: int = 0
    waiting: int = 0
    rejected: Counter[RejectReason] = field(default_factory=Counter)


class Validator:
    """Decrypts, authenticates, decodes and deduplicates messages. Not thread-safe.

    Args:
        opener: Opens envelopes.
        node_certificates: Finds the nodes' certificates.
        node_states: Knows which messages were accepted before.
        descriptions: Finds the layouts of frames and statements.
        missing_layouts: Asks for those that are missing.
        encryptor: Encrypts biometric messages.
        now: UTC ns.
    """

    def __init__(
        self,
        *,
        opener: Opener,
        node_certificates: NodeCertificates,
        node_states: NodeStates,
        descriptions: Descriptions,
        missing_layouts: MissingLayouts,
        encryptor: BiometricEncryptor,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        self._opener = opener
        self._node_certificates = node_certificates
        self._node_states = node_states
        self._descriptions = descriptions
        self._missing_layouts = missing_layouts
        self._encryptor = encryptor
        self._now = now

    def validate(self, received_messages: Sequence[ReceivedMessage]) -> IngestResult:
        """Validate messages, in order. Call `committed` or `reset` afterwards.

        A node whose key or state cannot be read gets no acknowledgement; other nodes do.
        """
        self._node_certificates.refresh()
        result = IngestResult()
        received = self._now()
        for message in received_messages:
            try:
                node, stream = _parse_topic(message)
                opened = self._open(message, node, stream)
            except EskinError as error:
                self._reject(result, message, _reason(error, message), error)
                continue
            if opened.sender != node:
                forgery = MessageError(f"sealed by {opened.sender!r}")
                self._reject(result, message, RejectReason.MISADDRESSED, forgery)
                continue
            try:
                self._accept(result, message, node, stream, opened, received)
            except (PrivacyError, SpoolError) as error:
                self._reject(result, message, RejectReason.INTERNAL_ERROR, error)
        result.batch.certificates = self._node_certificates.uncommitted()
        self._descriptions.fill(result.batch)
        return result

    def committed(self, batch: Batch) -> None:
        """Keep what was learned from a batch that is durable now."""
        self._node_certificates.committed()
        self._node_states.committed(batch.nodes)
        self._descriptions.committed()

    def reset(self) -> None:
        """Drop what is cached of nodes after a failed batch."""
        self._node_states.reset()
        self._descriptions.reset()

    def _open(self, message: ReceivedMessage, node: str, stream: Stream) -> Opened:
        if stream is Stream.STATUS:
            chain = introduction(message.payload)
            if chain is not None:
                self._node_certificates.introduce(chain, node)
        return self._opener.open(message.payload, topic=message.topic)

    def _accept(
        self,
        result: IngestResult,
        received_message: ReceivedMessage,
        node: str,
        stream: Stream,
        opened: Opened,
        received: int,
    ) -> None:
        state = self._node_states[node]
        result.batch.nodes[node] = state
        state.thumbprint = opened.thumbprint
        try:
            message = decode(opened.plaintext)
            if not isinstance(message, _MESSAGE_TYPES[stream]):
                raise MessageError(f"{type(message).__name__} is no message for {stream}")
            if isinstance(message, Patch | Layout):
                self._add_description(result, received_message, node, opened.plaintext)
                return
        except EskinError as error:
            self._add_dead_letter(result, received_message, node, opened.plaintext, str(error))
            return
        position = message.position
        if state.is_duplicate(position):
            result.duplicates += 1
        else:
            body = opened.plaintext
            if isinstance(message, EncodedFrame | Statements):
                privacy = self._find_class(
                    result, received_message, node, message, opened.plaintext
                )
                if privacy is None:
                    return
                if privacy is Privacy.BIOMETRIC:
                    body = self._encryptor.encrypt(node, message, body)
            state.add(position)
            result.batch.messages.append(SpoolMessage(node, received, body, *position))
            # A message of an earlier boot may be a duplicate that only the cloud can detect.
            if position.boot >= state.held.boot:
                result.messages.append((node, message, not received_message.retained))
                if isinstance(message, Status):
                    state.status = opened.plaintext
        result.positions.setdefault(node, []).append(position)
        state.release(opened.held)

    def _add_description(
        self,
        result: IngestResult,
        received_message: ReceivedMessage,
        node: str,
        plaintext: bytes,
    ) -> None:
        """Keep a patch or a layout, which has no position to acknowledge."""
        try:
            self._descriptions.add(node, plaintext)
        except MessageError as error:
            self._reject(result, received_message, RejectReason.TOO_MANY_DESCRIPTIONS, error)

    def _find_class(
        self,
        result: IngestResult,
        received_message: ReceivedMessage,
        node: str,
        message: Described,
        plaintext: bytes,
    ) -> Privacy | None:
        """The privacy class of a message.

        ``None`` if its layout is not there or does not fit: then it waits, or is dead.
        """
        skin = None
        try:
            found = self._descriptions.find(node, message.layout)
            if isinstance(found, DescribedLayout):
                skin = found
                self._missing_layouts.found(node, message.layout)
                if isinstance(message, Statements):
                    privacy = skin.require_statements(message)
                else:
                    privacy = skin.require_frame(message)
                self._descriptions.use(node, message.layout)
                return privacy
            request = self._missing_layouts.wait(node, message.layout, found)
            if request.hashes:
                result.want.setdefault(node, {}).update(dict.fromkeys(request.hashes))
            fault = request.fault
        except MessageError as error:
            fault = str(error)
        if fault is None:
            result.waiting += 1
            return None
        # Where no layout says that the samples are not biometric, they are not kept.
        body = plaintext if skin is not None and not skin.biometric_pages else b""
        position = message.position
        reason = f"boot {position.boot} sequence {position.sequence}: {fault}"
        fingerprint = hashlib.sha256(f"{node} {position}".encode() + body).digest()
        letter = DeadLetter(self._now(), node, reason, body, fingerprint)
        self._store_dead_letter(result, received_message, letter, position)
        return None

    def _add_dead_letter(
        self,
        result: IngestResult,
        message: ReceivedMessage,
        node: str,
        plaintext: bytes,
        reason: str,
    ) -> None:
        """Store an authentic message that cannot be decoded, and acknowledge its position."""
        state = self._node_states[node]
        position = _read_position(plaintext)
        if position is not None and state.is_duplicate(position):
            result.positions.setdefault(node, []).append(position)
            result.duplicates += 1
            return
        letter = DeadLetter(self._now(), node, reason, plaintext)
        letter = self._encryptor.encrypt_dead_letter(letter, position)
        self._store_dead_letter(result, message, letter, position)

    def _store_dead_letter(
        self,
        result: IngestResult,
        message: ReceivedMessage,
        letter: DeadLetter,
        position: Position | None,
    ) -> None:
        if position is not None:
            result.positions.setdefault(letter.node, []).append(position)
            self._node_states[letter.node].add(position)
        result.batch.dead_letters.append(letter)
        self._reject(result, message, RejectReason.UNREADABLE, MessageError(letter.reason))

    def _reject(
        self,
        result: IngestResult,
        message: ReceivedMessage,
        reason: RejectReason,
        error: EskinError,
    ) -> None:
        result.rejected[reason] += 1
        topic = message.topic[:_MAX_LOGGED_TOPIC]
        log.warning(
            "message rejected: reason=%s topic=%r error=%s",
            reason,
            topic,
            error,
            extra={"source": reason},
        )


def _parse_topic(message: ReceivedMessage) -> tuple[str, Stream]:
    if len(message.payload) > MOST_ENVELOPE:
        raise MessageError(
            f"message of {len(message.payload)} bytes; at most {MOST_ENVELOPE} are allowed"
        )
    node, stream = parse_node_topic(message.topic)
    if stream not in FROM_NODE:
        raise MessageError(f"nodes do not write {stream}")
    return node, stream


def _reason(error: EskinError, message: ReceivedMessage) -> RejectReason:
    for kind, reason in _REASONS:
        if isinstance(error, kind):
            return reason
    oversized = len(message.payload) > MOST_ENVELOPE
    return RejectReason.OVERSIZED if oversized else RejectReason.TOPIC


def _read_position(plaintext: bytes) -> Position | None:
    """Boot and sequence (fields 2 and 3) of an invalid message, if they are valid.

    The node stops sending a message whose position is acknowledged.
    """
    try:
        fields = load_any(plaintext, "message")
        if not isinstance(fields, dict):
            return None
        boot = integer(fields.get(2), "field 2", 0, MOST_COUNT)
        return Position(boot, integer(fields.get(3), "field 3", 0, MOST_COUNT))
    except MessageError:
        return None
