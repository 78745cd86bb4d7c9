"""Strict reading of CBOR maps (RFC 8949, deterministic encoding of section 4.2).

Whatever a peer sends ends as a value in its allowed range, or as a `MessageError` that names field
and value. The bytes must be the deterministic encoding: then one message has one form, and keeping
the bytes keeps the message.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, TypeVar

import cbor2

from eskin.errors import MessageError, shown
from eskin.wire.messages.wellformed import require_plain
from eskin.wire.timestamp import MOST_INSTANT

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.wire.messages.command import Value

MOST_BYTES: Final = 65_536
"""Size limit of one plaintext message."""
MOST_COUNT: Final = 2**53 - 1
"""Limit of counters: the integers that JavaScript keeps exact."""
_KEYS: Final = 2**16


def dump(fields: Mapping[int, object]) -> bytes:
    """Encode a map, its keys in ascending order."""
    return cbor2.dumps(dict(sorted(fields.items())))


def load(data: bytes) -> Fields:
    """Decode a map.

    Raises:
        MessageError: Too long, no CBOR, no map with integer keys, or not encoded deterministically.
    """
    if len(data) > MOST_BYTES:
        raise MessageError(f"message of {len(data)} bytes; at most {MOST_BYTES} are allowed")
    value = load_any(data, "message")
    if not isinstance(value, dict) or not _are_keys(value):
        raise MessageError("message is no CBOR map with small integer keys")
    try:
        again = dump(value) if list(value) != sorted(value) else cbor2.dumps(value)
    except cbor2.CBORError as error:
        raise MessageError(f"message holds what CBOR cannot say twice: {error}") from error
    if again != data:
        raise MessageError("message is not in deterministic CBOR encoding (RFC 8949, 4.2)")
    return Fields(value)


def load_any(data: bytes, what: str) -> object:
    """Decode one CBOR item.

    Raises:
        MessageError: It is no CBOR.
    """
    require_plain(data, what)
    try:
        value: object = cbor2.loads(data)
    except cbor2.CBORError as error:
        raise MessageError(f"{what} is no CBOR: {error}") from error
    return value


class Fields:
    """The fields of one decoded map; every reader checks type and range."""

    __slots__ = ("_fields",)

    def __init__(self, fields: Mapping[int, object]) -> None:
        self._fields = fields

    def only(self, keys: frozenset[int]) -> None:
        """Refuse fields that the message does not have.

        Raises:
            MessageError: There is one.
        """
        for key in self._fields:
            if key not in keys:
                raise MessageError(f"field {key} is unknown")

    def has(self, key: int) -> bool:
        """Whether the field is there."""
        return key in self._fields

    def raw(self, key: int) -> object:
        """The value as decoded.

        Raises:
            MessageError: It is missing.
        """
        try:
            return self._fields[key]
        except KeyError:
            raise MessageError(f"field {key} is missing") from None

    def integer(self, key: int, least: int, most: int) -> int:
        """An integer in ``[least, most]``."""
        return integer(self.raw(key), f"field {key}", least, most)

    def real(self, key: int, least: float = -math.inf, most: float = math.inf) -> float:
        """A float in ``[least, most]``, never NaN."""
        return real(self.raw(key), f"field {key}", least, most)

    def text(self, key: int, longest: int) -> str:
        """A text of 1 to ``longest`` characters, all printable."""
        return text(self.raw(key), f"field {key}", longest)

    def octets(self, key: int, least: int, most: int) -> bytes:
        """A byte string of ``least`` to ``most`` bytes."""
        return octets(self.raw(key), f"field {key}", least, most)

    def items(self, key: int, most: int) -> list[object]:
        """An array of at most ``most`` items."""
        return items(self.raw(key), f"field {key}", most)

    def optional_items(self, key: int, most: int) -> list[object]:
        """An array of 1 to ``most`` items, or no items where it is left out."""
        if not self.has(key):
            return []
        found = self.items(key, most)
        if not found:
            raise MessageError(f"field {key} has no items; leave it out")
        return found

    def instants(self, key: int) -> tuple[int, int]:
        """A pair of UTC times in ns, in order."""
        return integer_pair(self.raw(key), f"field {key}", -MOST_INSTANT, MOST_INSTANT)

    def counts(self, key: int) -> tuple[int, int]:
        """A pair of counters, in order."""
        return integer_pair(self.raw(key), f"field {key}", 0, MOST_COUNT)

    def interval(self, key: int) -> tuple[float, float]:
        """A pair of floats, in order; infinite where a side is unbounded."""
        lo, hi = pair(self.raw(key), f"field {key}")
        bounds = real(lo, f"field {key}"), real(hi, f"field {key}")
        if bounds[0] > bounds[1]:
            raise MessageError(f"field {key} is reversed: {bounds[0]!r} > {bounds[1]!r}")
        return bounds


def integer(value: object, what: str, least: int, most: int) -> int:
    """Check an integer."""
    if type(value) is not int:
        raise MessageError(f"{what} is {shown(value)}; expected an integer")
    if not least <= value <= most:
        raise MessageError(f"{what} is {shown(value)}; allowed is {least} to {most}")
    return value


def real(value: object, what: str, least: float = -math.inf, most: float = math.inf) -> float:
    """Check a float."""
    if type(value) is not float:
        raise MessageError(f"{what} is {shown(value)}; expected a float")
    if not least <= value <= most:
        raise MessageError(f"{what} is {value!r}; allowed is {least} to {most}")
    return value


def text(value: object, what: str, longest: int) -> str:
    """Check a text."""
    if type(value) is not str:
        raise MessageError(f"{what} is {shown(value)}; expected a text")
    if not 1 <= len(value) <= longest or not value.isprintable():
        raise MessageError(
            f"{what} is {shown(value)}; expected 1 to {longest} printable characters"
        )
    return value


def items(value: object, what: str, most: int) -> list[object]:
    """Check an array."""
    if not isinstance(value, list):
        raise MessageError(f"{what} is {shown(value)}; expected an array")
    if len(value) > most:
        raise MessageError(f"{what} has {len(value)} items; at most {most} are allowed")
    return value


def octets(value: object, what: str, least: int, most: int) -> bytes:
    """Check a byte string."""
    if type(value) is not bytes:
        raise MessageError(f"{what} is {shown(value)}; expected a byte string")
    if not least <= len(value) <= most:
        raise MessageError(f"{what} has {len(value)} bytes; allowed is {least} to {most}")
    return value


def pair(value: object, what: str) -> tuple[object, object]:
    """Check an array of two."""
    first, second = row(value, what, 2)
    return first, second


def row(value: object, what: str, size: int) -> list[object]:
    """Check an array of so many."""
    found = items(value, what, size)
    if len(found) != size:
        raise MessageError(f"{what} has {len(found)} items; expected {size}")
    return found


def integer_pair(value: object, what: str, least: int, most: int) -> tuple[int, int]:
    """Check an array of two integers in order."""
    first, second = pair(value, what)
    lo, hi = integer(first, what, least, most), integer(second, what, least, most)
    if lo > hi:
        raise MessageError(f"{what} is reversed: {lo} > {hi}")
    return lo, hi


def _are_keys(value: dict[Any, object]) -> bool:
    if not value:
        return True
    return set(map(type, value)) == {int} and min(value) > -_KEYS and max(value) < _KEYS


T = TypeVar("T")

_LONGEST_KEY = 63
_LONGEST_TEXT = 4000
"""Such as the signature of a gesture key, with its certificates."""


def sort_texts(values: Mapping[str, T]) -> dict[str, T]:
    """The same map, its keys in the order of their encoding."""
    return dict(sorted(values.items(), key=lambda item: _place(item[0])))


def read_map(value: object, what: str, most: int) -> dict[str, object]:
    """Check a map with text keys.

    Raises:
        MessageError: It is none, has more than ``most`` entries, or they are in another order.
    """
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise MessageError(f"{what} is {shown(value)}; expected a map with text keys")
    if len(value) > most:
        raise MessageError(f"{what} has {len(value)} entries; at most {most} are allowed")
    keys = [text(key, f"{what}, key", _LONGEST_KEY) for key in value]
    if keys != sorted(keys, key=_place):
        raise MessageError(f"{what} is not in deterministic CBOR encoding (RFC 8949, 4.2)")
    return value


def read_texts(value: object, what: str, most: int) -> dict[str, Value]:
    """Check a map from texts to finite floats and texts.

    Raises:
        MessageError: It is none.
    """
    return {
        key: _value(item, f"{what}, {key}") for key, item in read_map(value, what, most).items()
    }


def _value(value: object, what: str) -> Value:
    if isinstance(value, str):
        return text(value, what, _LONGEST_TEXT)
    number = real(value, what)
    if not math.isfinite(number):
        raise MessageError(f"{what} is {number}; expected a finite number or a text")
    return number


def _place(key: str) -> tuple[int, bytes]:
    encoded = key.encode()
    return len(encoded), encoded


BYTES: Final = 2
"""Major type of byte strings."""
TEXT: Final = 3
"""Major type of texts."""
ARRAY: Final = 4
"""Major type of arrays."""
_WIDTHS: Final = ((24, 256, 1), (25, 65_536, 2), (26, 1 << 32, 4), (27, 1 << 64, 8))


@lru_cache(4096)
def opening(major: int, number: int) -> bytes:
    """The shortest head of an item (RFC 8949, section 3).

    Args:
        major: Its major type.
        number: Its length, or how many items it holds.
    """
    if number < 24:
        return bytes((major << 5 | number,))
    short, _, width = next(found for found in _WIDTHS if number < found[1])
    return bytes((major << 5 | short,)) + number.to_bytes(width)


def read_span(value: object, what: str) -> tuple[int, int, int]:
    """Read ``[boot, first, last]``.

    Raises:
        MessageError: It is none.
    """
    numbers = [integer(number, what, 0, MOST_COUNT) for number in items(value, what, 3)]
    if len(numbers) != 3 or numbers[1] > numbers[2]:
        raise MessageError(f"{what} holds {numbers}; expected boot, first <= last")
    return numbers[0], numbers[1], numbers[2]
