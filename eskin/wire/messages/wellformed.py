"""Looking over CBOR before it is decoded, so that no peer chooses what the decoder does.

A general decoder turns tags into regular expressions, decimals, sets and cycles, and keys into
entries of hash tables: some 40 kB of hostile bytes keep it busy for a minute. So nothing is decoded
that does not follow RFC 8949 with definite lengths, or holds a tag that the wire contract has not,
maps of more than 1000 entries, or items nested more than 16 deep; nor texts that are no UTF-8, with
each of which cbor2 5.9 loses the memory that its error takes.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from eskin.errors import MessageError
from eskin.kernels.jit import kernel, part

_DEEPEST: Final = 16
_WIDEST_MAP: Final = 1000
_CUT, _LENGTH, _TAG, _DEPTH, _WIDTH, _MORE, _TEXT = range(1, 8)
_FAULTS: Final = {
    _CUT: "it ends in the middle of an item",
    _LENGTH: "a length is indefinite or reserved",
    _TAG: "it holds a tag that has no place there",
    _DEPTH: f"it is nested more than {_DEEPEST} deep",
    _WIDTH: f"a map has more than {_WIDEST_MAP} entries",
    _MORE: "something follows it",
    _TEXT: "a text is no UTF-8",
}


def require_plain(data: bytes, what: str) -> None:
    """Check that bytes are one CBOR item that is safe to decode.

    Raises:
        MessageError: They are not.
    """
    fault = find_fault(data)
    if fault:
        raise MessageError(f"{what} is no CBOR that may be read: {_FAULTS[fault]}")


@kernel
def find_fault(data: bytes) -> int:
    """What is wrong with the outline, or 0; takes time in proportion to the bytes."""
    waiting = np.empty(_DEEPEST, np.int64)  # how many items are still to come, by depth
    waiting[0] = 1
    depth = place = 0
    while depth >= 0:
        if waiting[depth] == 0:
            depth -= 1
            continue
        waiting[depth] -= 1
        count, behind = _head(data, place)
        if behind < 0:
            return _CUT if count == 0 else _LENGTH
        major, place = data[place] >> 5, behind
        fault = _find_fault_of_one(data, major, count, behind)
        if fault:
            return fault
        if major in (2, 3):
            place += count
        elif 4 <= major <= 6:
            depth += 1
            if depth == _DEEPEST:
                return _DEPTH
            waiting[depth] = 1 if major == 6 else count * (2 if major == 5 else 1)
        if place > len(data) or (depth >= 0 and waiting[depth] > len(data)):
            return _CUT
    return _MORE if place != len(data) else 0


@part
def _find_fault_of_one(data: bytes, major: int, count: int, behind: int) -> int:
    """What is wrong with an item by itself: its type, its number, and what follows its head."""
    end = behind + count
    if major == 3 and end <= len(data) and not _is_text(data, behind, end):
        return _TEXT
    if major == 5 and count > _WIDEST_MAP:
        return _WIDTH
    if major == 6 and count not in (16, 18):
        return _TAG
    return 0


@part
def _head(data: bytes, place: int) -> tuple[int, int]:
    """An item's number, and where it goes on; the latter is -1 where there is none."""
    if place >= len(data):
        return 0, -1
    short = data[place] & 31
    place += 1
    if short < 24:
        return short, place
    if short > 27:
        return 1, -1
    width = 1 << (short - 24)
    if place + width > len(data):
        return 0, -1
    count = 0
    for k in range(width):
        # No length is as great as that, and no integer's value is asked for.
        count = min(count, 1 << 40) << 8 | data[place + k]
    return count, place + width


@part
def _is_text(data: bytes, place: int, end: int) -> bool:
    """Whether bytes are UTF-8 (RFC 3629, section 4)."""
    while place < end:
        more, least, most = _following(data[place])
        if more < 0 or place + more >= end:
            return False
        for k in range(place + 1, place + more + 1):
            if not least <= data[k] <= most:
                return False
            least, most = 0x80, 0xBF
        place += more + 1
    return True


@part
def _following(first: int) -> tuple[int, int, int]:
    """How many bytes follow a character's first, -1 for none such, and the range of the second."""
    if first < 0x80:
        return 0, 0, 0
    if 0xC2 <= first < 0xE0:
        return 1, 0x80, 0xBF
    if 0xE0 <= first < 0xF0:  # none is longer than it must be, none is half of a pair
        return 2, 0xA0 if first == 0xE0 else 0x80, 0x9F if first == 0xED else 0xBF
    if 0xF0 <= first < 0xF5:
        return 3, 0x90 if first == 0xF0 else 0x80, 0x8F if first == 0xF4 else 0xBF
    return -1, 0, 0
