"""CBOR, compiled: the twin of `eskin_sensor_node.firmware.cbor`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.kernels.jit import part

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats

    Bytes = NDArray[np.uint8]

_UNSIGNED: Final = 0x00
_NEGATIVE: Final = 0x20
BYTES: Final = 0x40
ARRAY: Final = 0x80
MAP: Final = 0xA0
TAG: Final = 0xC0
"""Major types."""


class Scratch(NamedTuple):
    """One float, and the same as bits."""

    double: Floats
    bits: NDArray[np.int64]
    single: NDArray[np.float32]
    single_bits: NDArray[np.int32]


@part
def scratch() -> Scratch:
    """Room to look at a float's bits."""
    double, single = np.empty(1), np.empty(1, np.float32)
    return Scratch(double, double.view(np.int64), single, single.view(np.int32))


@part
def head(out: Bytes, at: int, major: int, value: int) -> int:
    """Begin an item; gives where the next one goes, as all of these do."""
    if value < 24:
        out[at] = major | value
        return at + 1
    size, info = 1, 24
    if value >= 0x100000000:
        size, info = 8, 27
    elif value >= 0x10000:
        size, info = 4, 26
    elif value >= 0x100:
        size, info = 2, 25
    out[at] = major | info
    for k in range(size):
        out[at + size - k] = (value >> (8 * k)) & 0xFF
    return at + 1 + size


@part
def integer(out: Bytes, at: int, value: int) -> int:
    """An integer."""
    if value >= 0:
        return head(out, at, _UNSIGNED, value)
    return head(out, at, _NEGATIVE, -1 - value)


@part
def real(out: Bytes, at: int, value: float, room: Scratch) -> int:
    """A binary64, never NaN."""
    if value - value != 0.0:
        out[at], out[at + 1], out[at + 2] = 0xF9, 0x7C if value > 0.0 else 0xFC, 0
        return at + 3
    room.double[0] = value
    bits = room.bits[0]
    out[at] = 0xFB
    for k in range(8):
        out[at + 8 - k] = (bits >> (8 * k)) & 0xFF
    return at + 9


@part
def copied(out: Bytes, at: int, piece: Bytes) -> int:
    """Bytes as they are."""
    for k in range(piece.size):
        out[at + k] = piece[k]
    return at + piece.size


@part
def begun(out: Bytes, at: int, kind: int, fields: int, boot: int, sequence: int) -> int:
    """Begin a message."""
    at = head(out, at, MAP, fields)
    at = integer(out, integer(out, at, 1), kind)
    at = integer(out, integer(out, at, 2), boot)
    return integer(out, integer(out, at, 3), sequence)


@part
def pair(out: Bytes, at: int, key: int, first: int, second: int) -> int:
    """A field with two integers."""
    at = head(out, integer(out, at, key), ARRAY, 2)
    return integer(out, integer(out, at, first), second)


@part
def reals(out: Bytes, at: int, key: int, first: float, second: float, room: Scratch) -> int:
    """A field with two floats."""
    at = head(out, integer(out, at, key), ARRAY, 2)
    return real(out, real(out, at, first, room), second, room)
