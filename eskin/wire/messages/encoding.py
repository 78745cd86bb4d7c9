"""How a block's bounds are written: ``f64``, ``f32`` or ``q16``, each rounded outward.

- ``f64``, ``f32``: IEEE 754, little endian (RFC 8746 tags 86, 85). Infinite where unbounded.
- ``q16``: ``(offset + code) · 2^exponent`` with integer offset and code, so that every decoder
  gets exactly the same binary64. Little endian unsigned 16 bit (tag 69). Code 65535 is an
  unbounded side.

A missing sample is unbounded on both sides: nothing is known of it.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final

import cbor2
import numpy as np

from eskin.errors import IntervalError, MessageError
from eskin.interval import Interval

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.messages.cbor_map import Fields

UNBOUNDED: Final = 65_535
"""The code of an unbounded side."""
_MOST_CODE: Final = 65_534
SAFE_EXPONENT: Final = 960
"""Up to which scales neither overflow nor become subnormal."""
MOST_OFFSET: Final = 2**53


class Encoding(IntEnum):
    """Names of the encodings (field 11 of a block)."""

    F64 = 0
    F32 = 1
    Q16 = 2


ENCODINGS: Final = tuple(Encoding)
_TYPES: Final = {
    Encoding.F64: ("<f8", 86, 8),
    Encoding.F32: ("<f4", 85, 4),
    Encoding.Q16: ("<u2", 69, 2),
}
"""Each encoding's numpy type, CBOR tag (RFC 8746), and bytes of a sample."""


class Scale:
    """The affine map of ``q16``: value = (offset + code) · 2^exponent.

    Attributes:
        exponent: Power of two, -1074 to 1023.
        offset: Integer, at most 2^53 in size.
    """

    __slots__ = ("exponent", "offset")

    def __init__(self, exponent: int, offset: int) -> None:
        self.exponent = exponent
        self.offset = offset

    @classmethod
    def covering(cls, values: Interval) -> Scale:
        """The finest scale that reaches all finite bounds."""
        bounds = np.concatenate([values.inf, values.sup])
        bounds = bounds[np.isfinite(bounds)]
        if bounds.size == 0:
            return cls(0, 0)
        lowest, highest = float(bounds.min()), float(bounds.max())
        magnitude = max(abs(lowest), abs(highest))
        exponent = max(math.frexp(magnitude)[1] - 53, -1074)
        while cls._span(lowest, highest, exponent) > _MOST_CODE:
            exponent += 1
        return cls(exponent, math.floor(math.ldexp(lowest, -exponent)) - 1)

    @staticmethod
    def _span(lowest: float, highest: float, exponent: int) -> int:
        first = math.floor(math.ldexp(lowest, -exponent)) - 1
        return math.ceil(math.ldexp(highest, -exponent)) + 1 - first

    def codes_down(self, values: Floats) -> NDArray[np.uint16]:
        """Codes of lower bounds; what they decode to is never above the value."""
        steps = np.floor(np.ldexp(values, -self.exponent))
        codes = np.where(np.isfinite(steps), steps, self.offset).astype(np.int64) - self.offset
        codes -= self._values(codes) > values  # a subnormal may have rounded up to zero
        return np.where(np.isfinite(values), codes, UNBOUNDED).astype(np.uint16)

    def codes_up(self, values: Floats) -> NDArray[np.uint16]:
        """Codes of upper bounds; what they decode to is never below the value."""
        steps = np.ceil(np.ldexp(values, -self.exponent))
        codes = np.where(np.isfinite(steps), steps, self.offset).astype(np.int64) - self.offset
        codes += self._values(codes) < values
        return np.where(np.isfinite(values), codes, UNBOUNDED).astype(np.uint16)

    def _values(self, codes: NDArray[np.int64]) -> Floats:
        steps = (codes + self.offset).astype(np.float64)
        if abs(self.exponent) <= SAFE_EXPONENT:
            return steps * 2.0**self.exponent  # exact: neither overflows nor becomes subnormal
        with np.errstate(over="ignore"):
            return np.ldexp(steps, self.exponent)

    def values(self, codes: NDArray[np.uint16], unbounded: float) -> Floats:
        """Decode; ``unbounded`` stands where the code says so."""
        values = self._values(codes.astype(np.int64))
        values[codes == UNBOUNDED] = unbounded
        return values


def encode_floats(values: Interval, encoding: Encoding) -> tuple[cbor2.CBORTag, cbor2.CBORTag]:
    """Write bounds as ``f64`` or ``f32``."""
    if encoding is Encoding.F64:
        return _typed(values.inf, encoding), _typed(values.sup, encoding)
    with np.errstate(over="ignore", under="ignore"):
        lo, hi = values.inf.astype(np.float32), values.sup.astype(np.float32)
        lo = np.where(lo > values.inf, np.nextafter(lo, np.float32(-np.inf)), lo)
        hi = np.where(hi < values.sup, np.nextafter(hi, np.float32(np.inf)), hi)
    return _typed(lo, encoding), _typed(hi, encoding)


def encode_q16(values: Interval, scale: Scale) -> tuple[cbor2.CBORTag, cbor2.CBORTag]:
    """Write bounds as ``q16``."""
    lo, hi = scale.codes_down(values.inf), scale.codes_up(values.sup)
    return _typed(lo, Encoding.Q16), _typed(hi, Encoding.Q16)


def decode_floats(lo: object, hi: object, n: int, encoding: Encoding) -> Interval:
    """Read ``f64`` or ``f32``.

    Raises:
        MessageError: Wrong tag or length, a NaN, or lo > hi.
    """
    with np.errstate(invalid="ignore"):  # a signalling NaN is refused below, as all are
        return _ordered(
            _untyped(lo, encoding, n, "lo").astype(np.float64),
            _untyped(hi, encoding, n, "hi").astype(np.float64),
        )


def decode_q16(lo: object, hi: object, n: int, scale: Scale) -> Interval:
    """Read ``q16``.

    Raises:
        MessageError: Wrong tag or length, or lo > hi.
    """
    return _ordered(
        scale.values(_untyped(lo, Encoding.Q16, n, "lo"), -np.inf),
        scale.values(_untyped(hi, Encoding.Q16, n, "hi"), np.inf),
    )


def _ordered(lo: Floats, hi: Floats) -> Interval:
    try:
        return Interval(lo, hi)
    except IntervalError as error:
        raise MessageError(f"samples are no intervals: {error}") from error


def require_scale(fields: Fields) -> Scale:
    """Read the scale of ``q16`` (fields 15 and 16).

    Raises:
        MessageError: A field is missing or out of range.
    """
    return Scale(fields.integer(15, -1074, 1023), fields.integer(16, -MOST_OFFSET, MOST_OFFSET))


def require_typed(value: object, encoding: Encoding, n: int, what: str) -> bytes:
    """The bytes of a typed array.

    Raises:
        MessageError: Wrong tag or length.
    """
    _, tag, size = _TYPES[encoding]
    if not isinstance(value, cbor2.CBORTag) or value.tag != tag:
        raise MessageError(f"{what} is no typed array with tag {tag}")
    data = value.value
    if not isinstance(data, bytes) or len(data) != n * size:
        raise MessageError(f"{what} does not hold {n} samples in {n * size} bytes")
    return data


def _typed(array: NDArray[np.generic], encoding: Encoding) -> cbor2.CBORTag:
    dtype, tag, _ = _TYPES[encoding]
    return cbor2.CBORTag(tag, array.astype(dtype).tobytes())


def typed_codes(codes: NDArray[np.uint16]) -> cbor2.CBORTag:
    """Codes of ``q16`` as a typed array."""
    return _typed(codes, Encoding.Q16)


def typed_floats(data: bytes, encoding: Encoding) -> Floats:
    """The numbers of a typed array of floats."""
    return np.frombuffer(data, dtype=_TYPES[encoding][0]).astype(np.float64)


def _untyped(value: object, encoding: Encoding, n: int, what: str) -> NDArray[Any]:
    return np.frombuffer(require_typed(value, encoding, n, what), dtype=_TYPES[encoding][0])
