"""CBOR as a node writes and reads it (RFC 8949).

It writes deterministic CBOR (section 4.2) with floats in 64 bits. An infinity takes 16 bits, as its
shortest form; other floats keep one width, so that messages of one kind keep one size. It reads
commands, and the results that it has written itself.
"""

import struct

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any


_UNSIGNED = 0x00
_NEGATIVE = 0x20
_BYTES = 0x40
_TEXT = 0x60
_ARRAY = 0x80
_MAP = 0xA0
_TAG = 0xC0
_FALSE = 0xF4
_TRUE = 0xF5
_INFINITY = b"\xf9\x7c\x00"
_MINUS_INFINITY = b"\xf9\xfc\x00"
_DEEPEST = 4
_WIDTHS = {24: ">B", 25: ">H", 26: ">I", 27: ">Q"}
_INFINITIES = {0x7C00: float("inf"), 0xFC00: float("-inf")}


class Reader:
    """Reads items from bytes, one after the other.

    Integers, texts, floats in 64 bits, infinities in 16, arrays and maps, of definite length.

    Args:
        data: The bytes.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def ended(self) -> bool:
        """Whether all bytes were read."""
        return self._at == len(self._data)

    def item(self, depth: int = 0) -> "Any":
        """The next item.

        Raises:
            ValueError: It is none that a node reads.
        """
        first = self._take(1)[0]
        major, short = first >> 5, first & 31
        if major == 7:
            return self._real(short)
        value = self._head(short)
        if major < 2:
            return value if major == 0 else -1 - value
        if major == 3:
            return self._take(value).decode()
        if major not in (4, 5) or depth == _DEEPEST:
            raise ValueError("no CBOR that is expected")
        if major == 4:
            return self._array(value, depth + 1)
        return self._map(value, depth + 1)

    def _take(self, n: int) -> bytes:
        if n > len(self._data) - self._at:
            raise ValueError("no CBOR: it ends too early")
        self._at += n
        return self._data[self._at - n : self._at]

    def _head(self, short: int) -> int:
        if short < 24:
            return short
        if short not in _WIDTHS:
            raise ValueError("no CBOR of definite length")
        width = _WIDTHS[short]
        value: int = struct.unpack(width, self._take(struct.calcsize(width)))[0]
        return value

    def _real(self, short: int) -> float:
        if short == 27:
            value: float = struct.unpack(">d", self._take(8))[0]
            return value
        bits = self._head(short) if short == 25 else -1
        if bits not in _INFINITIES:
            raise ValueError("no CBOR that is expected")
        return _INFINITIES[bits]

    def _array(self, n: int, depth: int) -> "list[Any]":
        found: list[Any] = []
        while len(found) < n:
            found.append(self.item(depth))
        return found

    def _map(self, n: int, depth: int) -> "dict[Any, Any]":
        found: dict[Any, Any] = {}
        while len(found) < n:
            key = self.item(depth)
            if not isinstance(key, (int, str)) or key in found:
                raise ValueError("no CBOR map that is expected")
            found[key] = self.item(depth)
        return found


def read_map(data: bytes) -> "dict[Any, Any]":
    """Read a message.

    Raises:
        ValueError: It is none.
    """
    reader = Reader(data)
    found = reader.item()
    if not isinstance(found, dict) or not reader.ended:
        raise ValueError("no CBOR map")
    return found


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

    def octets(self, value: "bytes | bytearray") -> None:
        """A byte string."""
        self._head(_BYTES, len(value))
        self.buffer.extend(value)

    def item(self, value: "Any") -> None:
        """A number, a truth value, a text, a byte string, or an array or a map of items."""
        if isinstance(value, bool):
            self.buffer.append(_TRUE if value else _FALSE)
        elif isinstance(value, int):
            self.integer(value)
        elif isinstance(value, float):
            self.real(value)
        elif isinstance(value, str):
            self.text(value)
        elif isinstance(value, bytes):
            self.octets(value)
        elif isinstance(value, dict):
            self.map(len(value))
            for key in sorted(value):
                self.integer(key)
                self.item(value[key])
        else:
            self.array(len(value))
            for each in value:
                self.item(each)

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


def put_text(out: Writer, key: int, value: str) -> None:
    """A text."""
    out.integer(key)
    out.text(value)
