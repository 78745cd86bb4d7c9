"""CBOR as a node reads it (RFC 8949): commands, and the results that it has written itself.

Integers, texts, floats in 64 bits and infinities in 16, arrays and maps, all of definite length.
"""

import struct

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

_DEEPEST = 4
_WIDTHS = {24: ">B", 25: ">H", 26: ">I", 27: ">Q"}
_INFINITIES = {0x7C00: float("inf"), 0xFC00: float("-inf")}


class Reader:
    """Reads items from bytes, one after the other.

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
