"""Split the keys that a query names, so that each statement has few parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

T = TypeVar("T")
_KEYS_PER_STATEMENT: Final = 4000
"""Some builds of SQLite accept 32,766 parameters, PostgreSQL 65,535."""


def key_batches(keys: Sequence[T], size: int = _KEYS_PER_STATEMENT) -> Iterator[Sequence[T]]:
    """Split keys into batches that fit one statement."""
    return (keys[begin : begin + size] for begin in range(0, len(keys), size))
