"""Maps with text keys, in deterministic encoding: short keys first (RFC 8949, section 4.2.1)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

from eskin.errors import MessageError, shown
from eskin.wire.messages.cbor_map import real, text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.wire.messages.command_schema import Value

T = TypeVar("T")

_LONGEST_KEY = 63
_LONGEST_TEXT = 64


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
