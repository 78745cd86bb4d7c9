"""Rows of whole numbers, as the first value and how much each differs from the one before."""

from __future__ import annotations

from itertools import accumulate
from typing import TYPE_CHECKING, Final

from eskin.wire.messages.cbor_map import integer, items

if TYPE_CHECKING:
    from collections.abc import Iterable

FARTHEST: Final = 100_000_000
"""Of a position from the map's origin, in um: 100 m."""


def write_differences(values: Iterable[int]) -> list[int]:
    """The first value, then how much each differs from the one before."""
    listed = list(values)
    before = [0, *listed[:-1]]
    return [value - last for value, last in zip(listed, before, strict=False)]


def read_differences(
    value: object, what: str, least: int, most: int, *, count: int
) -> tuple[int, ...]:
    """The values of which differences were written.

    Args:
        value: An item that was decoded.
        what: Names its field, for errors.
        least: Least value that is allowed.
        most: Greatest one.
        count: How many there may be.

    Raises:
        MessageError: They are none, too many, or outside of these bounds.
    """
    steps = [integer(each, what, -2 * most, 2 * most) for each in items(value, what, count)]
    values = tuple(accumulate(steps))
    for each in values:
        integer(each, what, least, most)
    return values
