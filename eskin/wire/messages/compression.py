"""A block of ``f32`` as a store keeps it: fewer bytes, from which each of its own comes back.

No node sends it. Eight bytes: ``FORM``, which no CBOR map begins with; how many bytes stand between
the bounds (8 bits), behind them (16), how many samples there are, and how many bytes stand before
the bounds (16 each). Then these bytes, up to a whole word of 32 bits, and the bounds' own
(`eskin.kernels.float_bitpacking`). All is little endian.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import MessageError
from eskin.kernels.float_bitpacking import most_words, pack_floats, unpack_floats
from eskin.kernels.intrinsics import load
from eskin.kernels.jit import kernel, part
from eskin.kernels.rounding_mode import rounding_to_nearest
from eskin.wire.messages.block_header import MOST_SAMPLES
from eskin.wire.messages.field_offsets import ENCODING, HIGHS, LOWS, N, find_fields

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.messages.concatenated import Joined

FORM: Final = 2
"""The first byte."""
_FORM: Final = bytes([FORM])
_HEAD: Final = 8
_WORD: Final = 4
_F32: Final = 1
_MOST_BETWEEN: Final = 0xFF
_MOST_AROUND: Final = 1024
"""Bytes of a block beside its bounds; that no usual one has."""
_ROOM: Final = most_words(MOST_SAMPLES) + (_HEAD + _MOST_AROUND) // _WORD + 1
"""Words that a block may take before it is known to be longer so."""


def is_compressed(data: bytes) -> bool:
    """Whether what lies in a store is a block in this form."""
    return data[:1] == _FORM


@rounding_to_nearest
def compress_all(messages: Joined) -> list[bytes | None]:
    """Each message in this form; `None` where it is no ``f32`` block, or would not be shorter."""
    ends = np.empty_like(messages.ends)
    made = _compress_all(np.frombuffer(messages.data, np.uint8), messages.ends, ends)
    whole, begin = made.tobytes(), 0
    found: list[bytes | None] = []
    for end in ends.tolist():
        found.append(whole[begin:end] if end > begin else None)
        begin = end
    return found


def decompress(data: bytes) -> bytes:
    """A block that lies in a store, byte for byte, whether it is in this form or not.

    Raises:
        MessageError: It is in this form, and damaged.
    """
    if not is_compressed(data):
        return data
    lo, hi, middle = _open(data)
    end = middle + data[1]
    behind = end + int.from_bytes(data[2:4], "little")
    begin, between, rest = data[_HEAD:middle], data[middle:end], data[end:behind]
    return b"".join((begin, lo.tobytes(), between, hi.tobytes(), rest))


def compressed_bounds(data: bytes) -> tuple[Floats, Floats]:
    """The lower and the upper bounds of its samples.

    Raises:
        MessageError: It is not what `compress_all` made.
    """
    lo, hi, _ = _open(data)
    return lo.view(np.float32).astype(np.float64), hi.view(np.float32).astype(np.float64)


@rounding_to_nearest
def _open(data: bytes) -> tuple[NDArray[np.uint32], NDArray[np.uint32], int]:
    """The bounds' bits, and where the bytes before them end."""
    n = int.from_bytes(data[4:6], "little")
    lo, hi = np.empty(n, np.uint32), np.empty(n, np.uint32)
    if not _decompress(data, lo, hi):
        raise MessageError(f"a compressed block of {len(data)} bytes is damaged")
    return lo, hi, _HEAD + int.from_bytes(data[6:8], "little")


@kernel
def _decompress(data: bytes, lo: NDArray[np.uint32], hi: NDArray[np.uint32]) -> bool:
    """Read the bounds; gives whether this is what `compress_all` made of as many samples."""
    if len(data) < _HEAD or data[0] != FORM:
        return False
    place = _HEAD + data[1] + (data[2] | data[3] << 8) + (data[6] | data[7] << 8)
    return unpack_floats(data, place + -place % _WORD, lo, hi)


@kernel
def _compress_all(
    data: NDArray[np.uint8], ends: NDArray[np.int64], made_ends: NDArray[np.int64]
) -> NDArray[np.uint8]:
    """Compress messages side by side.

    Args:
        data: Of all messages.
        ends: Where each of them ends.
        made_ends: For the result: where what was made of each ends.
    """
    words = np.empty(len(data) // _WORD + _ROOM, np.uint32)
    begin = place = 0
    for k in range(ends.size):
        message = data[begin : ends[k]]
        place += _compress(message, words[place:])
        made_ends[k] = _WORD * place
        begin = ends[k]
    return words[:place].view(np.uint8)


@part
def _compress(data: NDArray[np.uint8], out: NDArray[np.uint32]) -> int:
    """Compress a message; gives how many words it takes, none where it stays as it is."""
    good, said = find_fields(data)
    n, before = said[N], said[LOWS]
    between, behind = said[HIGHS] - before - _WORD * n, len(data) - said[HIGHS] - _WORD * n
    if not good or said[ENCODING] != _F32 or not 0 < n <= MOST_SAMPLES:
        return 0
    if before <= 0 or not 0 <= between <= _MOST_BETWEEN or behind < 0:
        return 0
    around = before + between + behind
    if around > _MOST_AROUND:
        return 0
    head = out.view(np.uint8)
    head[0], head[1], head[2], head[3] = FORM, between, behind & 255, behind >> 8
    head[4], head[5], head[6], head[7] = n & 255, n >> 8, before & 255, before >> 8
    middle, end = _HEAD + before, _HEAD + before + between
    head[_HEAD:middle] = data[:before]
    head[middle:end] = data[said[HIGHS] - between : said[HIGHS]]
    place = _HEAD + around
    head[end:place] = data[len(data) - behind :]
    while place % _WORD:
        head[place] = 0
        place += 1
    end = pack_floats(data, (before, said[HIGHS]), n, out, place // _WORD)
    if end < 0 or _WORD * end >= len(data):
        return 0
    same = _comes_back(head[: _WORD * end], place, data, (before, said[HIGHS]), n)
    return end if same else 0


@part
def _comes_back(
    made: NDArray[np.uint8], place: int, data: NDArray[np.uint8], places: tuple[int, int], n: int
) -> bool:
    """Whether the bounds are read from what was made bit by bit as they came."""
    lo, hi = np.empty(n, np.uint32), np.empty(n, np.uint32)
    good = unpack_floats(made, place, lo, hi)
    wrong = np.uint32(0)
    for k in range(n):
        wrong |= lo[k] ^ load(data, places[0], k, np.uint32)
    for k in range(n):
        wrong |= hi[k] ^ load(data, places[1], k, np.uint32)
    return good and wrong == 0
