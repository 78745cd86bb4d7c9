"""Samples of blocks that were checked when they were stored, in each form: bounds alone, fast."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import cbor2
import numpy as np

from eskin.kernels.intrinsics import load
from eskin.kernels.jit import kernel, part
from eskin.wire.messages.compacted_block import Pack, is_pack
from eskin.wire.messages.compression import compressed_bounds, is_compressed
from eskin.wire.messages.encoding import (
    ENCODINGS,
    SAFE_EXPONENT,
    UNBOUNDED,
    Encoding,
    Scale,
    typed_floats,
)
from eskin.wire.messages.field_offsets import (
    ENCODING,
    EXPONENT,
    HIGHS,
    LOWS,
    OFFSET,
    N,
    find_fields,
)

if TYPE_CHECKING:
    from eskin.interval import Floats

_Q16: Final = 2
_F32: Final = 1
_SIZES: Final = (8, 4, 2)
"""Bytes of a bound, by encoding."""


def read_bounds(data: bytes) -> tuple[Floats, Floats]:
    """The lower and the upper bounds of the samples of a stored block, or of a pack.

    Args:
        data: A block's bytes, as `Block.decode` took them before, or what `compress_all` or `pack`
            made of blocks.
    """
    if is_pack(data):
        return Pack.read(data).bounds()
    if is_compressed(data):
        return compressed_bounds(data)
    usual, bounds = _read(data)
    return (bounds[0], bounds[1]) if usual else _read_any(data)


def _read_any(data: bytes) -> tuple[Floats, Floats]:
    """The same of a scale that is beyond `SAFE_EXPONENT`."""
    fields = cbor2.loads(data)
    encoding, lo, hi = ENCODINGS[fields[ENCODING]], fields[LOWS].value, fields[HIGHS].value
    if encoding is Encoding.Q16:
        scale = Scale(fields[EXPONENT], fields[OFFSET])
        codes = np.frombuffer(lo, "<u2"), np.frombuffer(hi, "<u2")
        return scale.values(codes[0], -np.inf), scale.values(codes[1], np.inf)
    return typed_floats(lo, encoding), typed_floats(hi, encoding)


@kernel
def _read(data: bytes) -> Any:
    """Both bounds, shape ``(2, n)``, and before them whether they could be read here."""
    good, said = find_fields(data)
    n, encoding, lows, highs = said[N], said[ENCODING], said[LOWS], said[HIGHS]
    good = good and n > 0 and 0 <= encoding <= _Q16
    good = good and abs(said[EXPONENT]) <= SAFE_EXPONENT and 0 < lows < highs
    bounds = np.empty((2, n if good else 0))
    if not good or highs + n * _SIZES[encoding] > len(data):
        return False, bounds
    if encoding == _Q16:
        _scale(data, lows, (said[OFFSET], said[EXPONENT]), -np.inf, bounds[0])
        _scale(data, highs, (said[OFFSET], said[EXPONENT]), np.inf, bounds[1])
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
