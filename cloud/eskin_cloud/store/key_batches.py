"""Keys in batches that fit one statement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

T = TypeVar("T")
KEYS_PER_STATEMENT: Final = 4000
"""Some builds of SQLite accept 32,766 parameters, PostgreSQL 65,535."""


def key_batches(keys: Sequence[T], size: int = KEYS_PER_STATEMENT) -> Iterator[Sequence[T]]:
    """Split keys into batches that fit one statement."""
    return (keys[begin : begin + size] for begin in range(0, len(keys), size))
