"""Pairs of columns that are neighbours: two bytes a pair, ascending."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final, TypeAlias

from eskin.errors import MessageError
from eskin.wire.messages.cbor_map import octets

if TYPE_CHECKING:
    from collections.abc import Iterable

Pairs: TypeAlias = "tuple[tuple[int, int], ...]"
MOST_PAIRS: Final = 64 * 64
"""All pairs of two patches."""


def write_pairs(pairs: Iterable[tuple[int, int]]) -> bytes:
    """Two bytes a pair."""
    return b"".join(map(bytes, pairs))


def read_pairs(value: object, what: str) -> Pairs:
    """Read pairs of columns.

    Raises:
        MessageError: It is no byte string of pairs.
    """
    data = octets(value, what, 2, 2 * MOST_PAIRS)
    if len(data) % 2:
        raise MessageError(f"{what} has {len(data)} bytes; expected two a pair")
    return tuple(zip(data[::2], data[1::2], strict=True))


def require_pairs(pairs: Pairs, columns: tuple[int, int], what: str) -> None:
    """Check that pairs are ascending, none twice, of columns that there are.

    Raises:
        MessageError: They are not.
    """
    if any(second <= first for first, second in pairwise(pairs)):
        raise MessageError(f"{what} names pairs twice, or not in ascending order")
    for pair in pairs:
        if not (0 <= pair[0] < columns[0] and 0 <= pair[1] < columns[1]):
            raise MessageError(f"{what} names columns {pair}; there are {columns}")
