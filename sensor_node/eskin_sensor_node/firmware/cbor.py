"""CBOR as a node writes it: RFC 8949, deterministic (section 4.2), floats in 64 bits.

An infinity takes 16 bits, as its shortest form; other floats keep one width, so that messages of
one kind keep one size.
"""

import struct

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

_UNSIGNED = 0x00
_NEGATIVE = 0x20
_BYTES = 0x40
_TEXT = 0x60
_ARRAY = 0x80
_MAP = 0xA0
_TAG = 0xC0
_INFINITY = b"\xf9\x7c\x00"
_MINUS_INFINITY = b"\xf9\xfc\x00"


class Writer:
    """Appends items to a buffer."""

    __slots__ = ("buffer",)

    def __init__(self) -> None:
        self.buffer = bytearray()

    def integer(self, value: int) -> None:
        """An integer of up to 64 bits."""
        if value >= 0:
            self._head(_UNSIGNED, value)
        else:
            self._head(_NEGATIVE, -1 - value)

    def real(self, value: float) -> None:
        """A binary64, never NaN."""
        if value - value == 0.0:
            self.buffer.append(0xFB)
            self.buffer.extend(struct.pack(">d", value))
        else:
            self.buffer.extend(_INFINITY if value > 0.0 else _MINUS_INFINITY)

    def text(self, value: str) -> None:
        """A text."""
        encoded = value.encode()
        self._head(_TEXT, len(encoded))
        self.buffer.extend(encoded)

    def typed_array(self, tag: int, content: "bytes | bytearray") -> None:
        """A typed array (RFC 8746)."""
        self._head(_TAG, tag)
        self._head(_BYTES, len(content))
        self.buffer.extend(content)

    def array(self, n: int) -> None:
        """Begin an array of n items."""
        self._head(_ARRAY, n)

    def map(self, n: int) -> None:
        """Begin a map of n pairs."""
        self._head(_MAP, n)

    def _head(self, major: int, value: int) -> None:
        if value < 24:
            self.buffer.append(major | value)
        elif value < 0x100:
            self.buffer.extend(struct.pack(">BB", major | 24, value))
        elif value < 0x10000:
            self.buffer.extend(struct.pack(">BH", major | 25, value))
        elif value < 0x100000000:
            self.buffer.extend(struct.pack(">BI", major | 26, value))
        else:
            self.buffer.extend(struct.pack(">BQ", major | 27, value))


def put_integer(out: Writer, key: int, value: int) -> None:
    """A number."""
    out.integer(key)
    out.integer(value)


def put_integers(out: Writer, key: int, values: "Sequence[int]") -> None:
    """An array of numbers."""
    out.integer(key)
    out.array(len(values))
    for value in values:
        out.integer(value)


def put_real(out: Writer, key: int, value: float) -> None:
    """A float."""
    out.integer(key)
    out.real(value)


def put_reals(out: Writer, key: int, values: "Sequence[float]") -> None:
    """An array of floats."""
    out.integer(key)
    out.array(len(values))
    for value in values:
        out.real(value)


def put_text(out: Writer, key: int, value: str) -> None:
    """A text."""
    out.integer(key)
    out.text(value)
