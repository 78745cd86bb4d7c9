"""Rows that are not as they were written: a reader goes on without them, and says which they are.

A flipped bit on a disk is told by the row's digest. What a damaged row held is a gap from then on:
its samples are unknown, never invented. Each row is logged and counted once by a process; whoever
answers a question collects those that the answer lacks (`collected`).
"""

from __future__ import annotations

import logging
from contextlib import contextmanager
from contextvars import ContextVar
from struct import Struct
from struct import error as StructError  # noqa: N812 - it is a class
from threading import Lock
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

from eskin.errors import StoreError
from eskin.runtime.digest import checksum
from eskin.runtime.digest import digest as digest_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from sqlalchemy import RowMapping

log = logging.getLogger(__name__)

_MOST: Final = 100_000


_HEAD: Final = Struct("<10q8s3d")


class Head(NamedTuple):
    """The columns of a block's row that say what ``data`` holds, and the digest of ``data``.

    Attributes:
        node: As in its table, like all the others.
    """

    node: str
    channel: str
    boot: int
    sequence: int
    t: int
    t_end: int
    error: int
    t_lo: int
    t_hi: int
    dt: int
    n: int
    lo: float
    hi: float
    coverage: float
    packed: int | None
    digest: bytes

    @classmethod
    def of(cls, row: Mapping[str, Any] | RowMapping) -> Self:
        """Those of a row."""
        return cls(*(row[name] for name in cls._fields))

    @property
    def place(self) -> DamagedRow:
        """Where the row is."""
        return DamagedRow(self.node, self.boot, self.sequence, self.packed)

    def checksum(self) -> int | None:
        """What column ``head`` holds; ``None`` where a damaged column has another type."""
        packed = -1 if self.packed is None else self.packed
        try:
            said = _HEAD.pack(*self[2:11], packed, self.digest, *self[11:14])
        except StructError:
            return None
        return checksum(f"{self.node} {self.channel} ".encode() + said)


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

    def __init__(self, row: object) -> None:
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
_collected: ContextVar[list[object] | None] = ContextVar("damaged rows", default=None)


@contextmanager
def collected() -> Iterator[list[object]]:
    """The damaged rows that are met while this runs, here and in threads that it starts."""
    found: list[object] = []
    token = _collected.set(found)
    try:
        yield found
    finally:
        _collected.reset(token)


def require_sound(row: Mapping[str, Any] | RowMapping) -> None:
    """Require that a row of blocks is as it was written.

    Args:
        row: With all columns but what tells when it came.

    Raises:
        DamagedRowError: It is not.
    """
    head = Head.of(row)
    if not is_sound(row["data"], head, row["head"]):
        raise DamagedRowError(head.place)


def is_sound(data: bytes, head: Head, own: int) -> bool:
    """Whether a block's row is as it was written; one that is not is noted, and left out.

    Args:
        data: Its bytes.
        head: Its columns.
        own: Column ``head``.
    """
    if digest_of(data) == head.digest and is_sound_head(head, own):
        return True
    note_damaged("blocks", head.place)
    return False


def is_sound_head(head: Head, own: int) -> bool:
    """The same of its columns alone."""
    if head.checksum() == own:
        return True
    note_damaged("blocks", head.place)
    return False


def sound_heads(rows: Iterable[RowMapping]) -> Iterator[RowMapping]:
    """Those of rows of blocks, read without their bytes, whose columns are as they were written."""
    return (row for row in rows if is_sound_head(Head.of(row), row["head"]))


def note_damaged(table: str, place: object) -> None:
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
