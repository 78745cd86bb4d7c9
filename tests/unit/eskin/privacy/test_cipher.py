"""What is veiled is read with the subject's key alone, and in its own place alone."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import BrokenSealError, MessageError, NoKeyError, PrivacyError
from eskin.privacy import Decryptor, Encryptor, SealedMessage
from eskin.privacy.cipher import span
from eskin.privacy.sealed_message import MINUTE, whole_minutes
from eskin.wire.messages import Position
from eskin.wire.messages.header import Kind
from tests.unit.cloud.messages import block, peak

if TYPE_CHECKING:
    from eskin.privacy import KeyStore
    from eskin.wire.messages import Block, Peak

CHANNEL = "t05.bioelectric"
BLOCK = block(3, [1.5, 2.5], [1.75, 2.75], channel=CHANNEL, unit="V")
PEAK = peak(4, channel=CHANNEL, unit="V")

EMPTY = SealedMessage(
    Position(1, 1), CHANNEL, Kind.BLOCK, "0" * 32, (0, 0), bytes(16), 0, bytes(16)
)


def veiled(keystore: KeyStore, message: Block | Peak = BLOCK) -> SealedMessage:
    return Encryptor().encrypt(keystore.create("Ada"), "hand", message, message.encode())


@pytest.mark.parametrize("message", [BLOCK, PEAK], ids=["block", "peak"])
def test_veiled_message_is_read_byte_for_byte(keystore: KeyStore, message: Block | Peak) -> None:
    wire = veiled(keystore, message).encode()
    again = SealedMessage.decode(wire)
    assert again.encode() == wire
    read, data = Decryptor(keystore).read("hand", again)
    assert data == read.encode() == message.encode()


def test_veiled_bytes_tell_the_minute_and_no_value(keystore: KeyStore) -> None:
    made = veiled(keystore)
    lo, hi = made.time
    assert lo <= span(BLOCK)[0] <= span(BLOCK)[1] <= hi
    assert lo % MINUTE == hi % MINUTE == 0
    told = (1.5, 2.5, 1.75, 2.75)
    for value in [struct.pack(order, one) for one in told for order in ("<d", ">d")]:
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
        {"channel": "t06.bioelectric"},
        {"kind": Kind.PEAK},
        {"time": (0, MINUTE)},
        {"number": 1},
        {"salt": bytes(16)},
    ],
    ids=str,
)
def test_veiled_message_is_read_in_its_own_place_alone(
    keystore: KeyStore, change: dict[str, object]
) -> None:
    moved = replace(veiled(keystore), **change)  # type: ignore[arg-type]
    with pytest.raises(BrokenSealError):
        Decryptor(keystore).decrypt("hand", moved)


def test_veiled_message_is_of_its_own_node_and_subject_alone(keystore: KeyStore) -> None:
    made = veiled(keystore)
    with pytest.raises(BrokenSealError):
        Decryptor(keystore).decrypt("palm", made)
    with pytest.raises(BrokenSealError):
        Decryptor(keystore).decrypt("hand", replace(made, subject=keystore.create("Bo").pseudonym))


def test_any_flipped_bit_of_the_ciphertext_is_refused(keystore: KeyStore) -> None:
    made = veiled(keystore)
    for index in range(0, len(made.ciphertext), 7):
        body = bytearray(made.ciphertext)
        body[index] ^= 1 << index % 8
        with pytest.raises(BrokenSealError):
            Decryptor(keystore).decrypt("hand", replace(made, ciphertext=bytes(body)))


def test_what_is_inside_must_be_what_stands_outside(keystore: KeyStore) -> None:
    subject = keystore.create("Ada")
    other = block(9, channel=CHANNEL, unit="V")
    swapped = Encryptor().encrypt(subject, "hand", BLOCK, other.encode())
    with pytest.raises(PrivacyError, match="is not what it claims"):
        Decryptor(keystore).read("hand", swapped)


def test_nonces_of_a_key_never_repeat_over_messages_and_starts(keystore: KeyStore) -> None:
    subject = keystore.create("Ada")
    seen = set()
    for _ in range(20):
        encryptor = Encryptor()
        for _ in range(20):
            made = encryptor.encrypt(subject, "hand", BLOCK, BLOCK.encode())
            seen.add((made.salt, made.number))
    assert len(seen) == 400


def test_erased_key_reads_nothing_from_that_moment(keystore: KeyStore) -> None:
    made, reader = veiled(keystore), Decryptor(keystore)
    reader.decrypt("hand", made)
    keystore.erase(made.subject)
    with pytest.raises(NoKeyError, match="its key is destroyed"):
        reader.decrypt("hand", made)


@pytest.mark.parametrize(
    "data",
    [
        BLOCK.encode(),
        b"\xa1\x01\x06",
        replace(EMPTY, ciphertext=b"").encode(),
        replace(EMPTY, kind=Kind.GAP).encode(),
        replace(EMPTY, subject="Ada").encode(),
    ],
)
def test_what_is_no_veiled_message_is_refused(data: bytes) -> None:
    with pytest.raises(MessageError):
        SealedMessage.decode(data)
