"""What is encrypted is read with the subject's key alone, and in its own place alone."""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import cbor2
import pycddl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import BrokenSealError, MessageError, NoKeyError, PrivacyError
from eskin.interval import Verdict
from eskin.privacy import Decryptor, Encryptor, SealedMessage, is_sealed
from eskin.privacy.cipher import span
from eskin.privacy.sealed_message import MINUTE, whole_minutes
from eskin.wire.frames import EncodedFrame, Frame, Peak, Statements
from eskin.wire.messages import Position
from eskin.wire.messages.header import Kind
from tests.unit.eskin.wire.frames.examples import FRAME

if TYPE_CHECKING:
    from eskin.privacy import KeyStore

Message = Frame | Statements

STATEMENTS = Statements(
    Position(5, 7),
    FRAME.layout,
    peaks=(
        Peak(2, 0, (5, 9), Verdict.CERTAIN, (1, 1), (1.5, 1.75), (0.5, 1.0), 0.999),
        Peak(2, 0, (20, 25), Verdict.CERTAIN, (1, 1), (2.5, 2.75), (0.5, 1.0), 0.999),
    ),
)
SUMMARY = EncodedFrame.decode(FRAME.encode())
CDDL = Path(__file__).parents[4] / "docs" / "eskin.cddl"
every_kind = pytest.mark.parametrize("message", [FRAME, STATEMENTS], ids=["frame", "statements"])

EMPTY = SealedMessage(
    Position(1, 1), bytes(32), Kind.STATEMENTS, "0" * 32, (0, 0), bytes(16), 0, bytes(16)
)


def encrypted(keystore: KeyStore, message: Message = STATEMENTS) -> SealedMessage:
    said = SUMMARY if isinstance(message, Frame) else message
    return Encryptor().encrypt(keystore.create("Ada"), "hand", said, message.encode())


@every_kind
def test_encrypted_message_is_read_byte_for_byte(keystore: KeyStore, message: Message) -> None:
    wire = encrypted(keystore, message).encode()
    assert is_sealed(wire)
    again = SealedMessage.decode(wire)
    assert again.encode() == wire
    read, data = Decryptor(keystore).read("hand", again)
    assert data == message.encode()
    assert read.position == message.position


@every_kind
def test_encrypted_message_is_as_the_documented_cddl_says(
    keystore: KeyStore, message: Message
) -> None:
    rule = re.sub(r"(?m)^message = .*$", "message = sealed", CDDL.read_text())
    schema = pycddl.Schema(rule)
    fields = cbor2.loads(encrypted(keystore, message).encode())
    schema.validate_cbor(cbor2.dumps(fields))
    for change in ({4: "t05.bioelectric", 5: 7}, {4: bytes(32), 5: 1}, {77: 1}):
        with pytest.raises(pycddl.ValidationError):
            schema.validate_cbor(cbor2.dumps(fields | change))


@every_kind
def test_place_is_of_its_kind(keystore: KeyStore, message: Message) -> None:
    made = encrypted(keystore, message)
    for kind in set(Kind) - {made.kind}:
        with pytest.raises(MessageError):
            SealedMessage.decode(replace(made, kind=kind).encode())


@every_kind
def test_encrypted_bytes_show_the_minute_and_no_value(keystore: KeyStore, message: Message) -> None:
    made = encrypted(keystore, message)
    lo, hi = made.time
    first, last = span(SUMMARY if isinstance(message, Frame) else message)
    assert lo <= first <= last <= hi < lo + 3 * MINUTE
    assert lo % MINUTE == hi % MINUTE == 0
    stated = (1.5, 2.5, 1.75, 2.75)
    for value in [struct.pack(order, one) for one in stated for order in ("<d", ">d")]:
        assert value not in made.encode()


@given(st.integers(-(2**63) + 1, 2**63 - 1), st.integers(0, 10**12))
def test_whole_minutes_enclose_a_time(lo: int, longer: int) -> None:
    hi = min(lo + longer, 2**63 - 1)
    first, last = whole_minutes((lo, hi))
    assert -(2**63) < first <= lo <= hi <= last < 2**63


@pytest.mark.parametrize(
    "change",
    [
        {"position": Position(1, 4)},
        {"position": Position(2, 3)},
        {"place": bytes(32)},
        {"place": (bytes(32), 0)},
        {"kind": Kind.FRAME},
        {"time": (MINUTE, 2 * MINUTE)},
        {"number": 1},
        {"salt": bytes(16)},
    ],
    ids=str,
)
def test_encrypted_message_is_read_in_its_own_place_alone(
    keystore: KeyStore, change: dict[str, object]
) -> None:
    moved = replace(encrypted(keystore), **change)  # type: ignore[arg-type]
    with pytest.raises(BrokenSealError):
        Decryptor(keystore).decrypt("hand", moved)


def test_encrypted_message_is_of_its_own_node_and_subject_alone(keystore: KeyStore) -> None:
    made = encrypted(keystore)
    with pytest.raises(BrokenSealError):
        Decryptor(keystore).decrypt("palm", made)
    with pytest.raises(BrokenSealError):
        Decryptor(keystore).decrypt("hand", replace(made, subject=keystore.create("Bo").pseudonym))


def test_any_flipped_bit_of_the_ciphertext_is_refused(keystore: KeyStore) -> None:
    made = encrypted(keystore)
    for index in range(0, len(made.ciphertext), 7):
        body = bytearray(made.ciphertext)
        body[index] ^= 1 << index % 8
        with pytest.raises(BrokenSealError):
            Decryptor(keystore).decrypt("hand", replace(made, ciphertext=bytes(body)))


def test_what_is_inside_must_be_what_stands_outside(keystore: KeyStore) -> None:
    subject = keystore.create("Ada")
    other = replace(STATEMENTS, position=Position(5, 9))
    swapped = Encryptor().encrypt(subject, "hand", STATEMENTS, other.encode())
    with pytest.raises(PrivacyError, match="is not what it claims"):
        Decryptor(keystore).read("hand", swapped)


def test_frame_inside_must_be_of_the_layout_and_page_outside(keystore: KeyStore) -> None:
    subject = keystore.create("Ada")
    for other in (replace(FRAME, page=2), replace(FRAME, layout=bytes(32)), STATEMENTS):
        swapped = Encryptor().encrypt(subject, "hand", SUMMARY, other.encode())
        with pytest.raises(PrivacyError):
            Decryptor(keystore).read("hand", swapped)


def test_nonces_of_a_key_never_repeat_over_messages_and_starts(keystore: KeyStore) -> None:
    subject = keystore.create("Ada")
    seen = set()
    for _ in range(20):
        encryptor = Encryptor()
        for _ in range(20):
            made = encryptor.encrypt(subject, "hand", STATEMENTS, STATEMENTS.encode())
            seen.add((made.salt, made.number))
    assert len(seen) == 400


def test_erased_key_reads_nothing_from_that_instant(keystore: KeyStore) -> None:
    made, reader = encrypted(keystore), Decryptor(keystore)
    reader.decrypt("hand", made)
    keystore.erase(made.subject)
    with pytest.raises(NoKeyError, match="its key is destroyed"):
        reader.decrypt("hand", made)


@pytest.mark.parametrize(
    "data",
    [
        STATEMENTS.encode(),
        cbor2.dumps({1: int(Kind.ENCRYPTED)}),
        replace(EMPTY, ciphertext=b"").encode(),
        replace(EMPTY, kind=Kind.STATUS).encode(),
        replace(EMPTY, subject="Ada").encode(),
    ],
)
def test_what_is_no_encrypted_message_is_refused(data: bytes) -> None:
    with pytest.raises(MessageError):
        SealedMessage.decode(data)
