"""Samples of blocks that were checked when they were stored, also of packs: bounds alone, fast."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import cbor2
import numpy as np

from eskin.kernels.compiled import kernel, part
from eskin.kernels.instructions import load
from eskin.messages.encoding import (
    ENCODINGS,
    SAFE_EXPONENT,
    UNBOUNDED,
    Encoding,
    Scale,
    typed_floats,
)
from eskin.messages.pack import Pack, is_pack

if TYPE_CHECKING:
    from eskin.interval import Floats

_KEYS: Final = 24
"""A block's keys are less."""
_N, _ENCODING, _LOWS, _HIGHS, _EXPONENT, _OFFSET = 9, 11, 12, 13, 15, 16
_Q16: Final = 2
_F32: Final = 1
_SIZES: Final = (8, 4, 2)
"""Bytes of a bound, by encoding."""


def read_bounds(data: bytes) -> tuple[Floats, Floats]:
    """The lower and the upper bounds of the samples of a stored block, or of a pack.

    Args:
        data: A block's bytes, as `Block.decode` took them before, or what `pack` made of several.
    """
    if is_pack(data):
        return Pack.read(data).bounds()
    usual, bounds = _read(data)
    return (bounds[0], bounds[1]) if usual else _read_any(data)


def _read_any(data: bytes) -> tuple[Floats, Floats]:
    """The same of a scale that is beyond `SAFE_EXPONENT`."""
    fields = cbor2.loads(data)
    encoding, lo, hi = ENCODINGS[fields[_ENCODING]], fields[_LOWS].value, fields[_HIGHS].value
    if encoding is Encoding.Q16:
        scale = Scale(fields[_EXPONENT], fields[_OFFSET])
        codes = np.frombuffer(lo, "<u2"), np.frombuffer(hi, "<u2")
        return scale.values(codes[0], -np.inf), scale.values(codes[1], np.inf)
    return typed_floats(lo, encoding), typed_floats(hi, encoding)


@kernel
def _read(data: bytes) -> Any:
    """Both bounds, shape ``(2, n)``, and before them whether they could be read here."""
    said = np.zeros(_KEYS, np.int64)
    place = 1
    while 0 < place < len(data) - 1 and data[place] < _KEYS:
        key, major = data[place], data[place + 1] >> 5
        number, begin, place = _item(data, place + 1)
        for _ in range(2 if major == 4 else 1 if major == 6 else 0):
            number, begin, place = _item(data, place)
        said[key] = begin if key in (_LOWS, _HIGHS) else number
    n, encoding, lows, highs = said[_N], said[_ENCODING], said[_LOWS], said[_HIGHS]
    good = place == len(data) and n > 0 and 0 <= encoding <= _Q16
    good = good and abs(said[_EXPONENT]) <= SAFE_EXPONENT and 0 < lows < highs
    bounds = np.empty((2, n if good else 0))
    if not good or highs + n * _SIZES[encoding] > len(data):
        return False, bounds
    if encoding == _Q16:
        _scale(data, lows, (said[_OFFSET], said[_EXPONENT]), -np.inf, bounds[0])
        _scale(data, highs, (said[_OFFSET], said[_EXPONENT]), np.inf, bounds[1])
    elif encoding == _F32:
        for k in range(n):
            bounds[0, k] = load(data, lows, k, np.float32)
            bounds[1, k] = load(data, highs, k, np.float32)
    else:
        for k in range(n):
            bounds[0, k] = load(data, lows, k, np.float64)
            bounds[1, k] = load(data, highs, k, np.float64)
    return True, bounds


@part
def _scale(data: bytes, place: int, affine: tuple[int, int], unbounded: float, out: Floats) -> None:
    offset, scale = np.float64(affine[0]), 2.0 ** affine[1]
    for k in range(out.size):
        code = load(data, place, k, np.uint16)
        # The sum of two whole numbers is rounded once, as that of integers is.
        out[k] = unbounded if code == UNBOUNDED else (offset + np.float64(code)) * scale


@part
def _item(data: bytes, place: int) -> tuple[int, int, int]:
    """An item's number, where it begins behind its head, and where it ends (RFC 8949, 3).

    Of a tag and an array the end is that of their head; it is negative where there is none.
    """
    if place >= len(data):
        return 0, -1, -1
    major, short = data[place] >> 5, data[place] & 31
    width = 0 if short < 24 else 1 << (short - 24)
    begin = place + 1 + width
    if begin > len(data):
        return 0, -1, -1
    number = 0 if width else short
    for k in range(place + 1, begin):
        number = number << 8 | data[k]
    if major == 1:
        return -1 - number, begin, begin
    if major in (2, 3):
        return number, begin, begin + number if 0 <= number <= len(data) - begin else -1
    return number, begin, begin
