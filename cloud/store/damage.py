"""Rows that are not as they were written: a reader goes on without them, and says which they are.

A flipped bit on a disk is told by the row's digest. What a damaged row held is a gap from then on:
its samples are unknown, never invented. Each row is logged and counted once by a process; whoever
answers a question collects those that the answer lacks (`collected`).
"""

from __future__ import annotations

import logging
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Lock
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from cloud.store.digest import digest as digest_of
from eskin.errors import StoreError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sqlalchemy import RowMapping

log = logging.getLogger(__name__)

_MOST: Final = 100_000


class DamagedRow(NamedTuple):
    """Where a damaged row is: of a pack, ``packed`` blocks from this one on."""

    node: str
    boot: int
    sequence: int
    packed: int | None

    def __str__(self) -> str:
        many = "" if self.packed is None else f" and {self.packed - 1} packed with it"
        return f"{self.node} boot {self.boot} sequence {self.sequence}{many}"


class DamagedRowError(StoreError):
    """A row is not as it was written.

    Attributes:
        row: Where it is.
    """

    def __init__(self, row: DamagedRow) -> None:
        self.row = row
        super().__init__(f"{row}: damaged in the store; bring it back from a backup")


class _Damages:
    """The damaged rows that this process has met."""

    def __init__(self) -> None:
        self._known: set[object] = set()
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._known)

    def note(self, table: str, place: object) -> None:
        """Log a row, once."""
        with self._lock:
            if place in self._known or len(self._known) >= _MOST:
                return
            self._known.add(place)
        log.error("row damaged: table=%s row=%s", table, place)


damages: Final = _Damages()
_collected: ContextVar[list[DamagedRow] | None] = ContextVar("damaged rows", default=None)


@contextmanager
def collected() -> Iterator[list[DamagedRow]]:
    """The damaged blocks that are met while this runs, here and in threads that it starts."""
    found: list[DamagedRow] = []
    token = _collected.set(found)
    try:
        yield found
    finally:
        _collected.reset(token)


def require_sound(row: Mapping[str, Any] | RowMapping) -> None:
    """Require that a row of blocks is as it was written.

    Args:
        row: With node, boot, sequence, packed, data and digest.

    Raises:
        DamagedRowError: It is not.
    """
    if digest_of(row["data"]) != row["digest"]:
        damaged = DamagedRow(row["node"], row["boot"], row["sequence"], row["packed"])
        note_damaged("blocks", damaged)
        raise DamagedRowError(damaged)


def is_sound(data: bytes, digest: bytes, place: DamagedRow) -> bool:
    """Whether a block's bytes are as they were written; what is not is noted, and left out."""
    if digest_of(data) == digest:
        return True
    note_damaged("blocks", place)
    return False


def note_damaged(table: str, place: DamagedRow) -> None:
    """Log and count a damaged row, and tell whoever collects them."""
    damages.note(table, place)
    found = _collected.get()
    if found is not None and place not in found:
        found.append(place)


def is_sound_tile(data: bytes, digest: bytes, place: tuple[object, ...]) -> bool:
    """The same of a chunk of tiles, in whose place blocks are read."""
    if digest_of(data) == digest:
        return True
    damages.note("tiles", place)
    return False
