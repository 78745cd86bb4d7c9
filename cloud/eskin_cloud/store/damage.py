"""Damaged rows: detected by their digests, skipped by readers, and reported.

The samples of a damaged row are unknown from then on, never invented. A process logs and counts
each row once; a query collects the rows that its answer lacks (`collect_damaged_rows`).
"""

from __future__ import annotations

import logging
from contextlib import contextmanager
from contextvars import ContextVar
from struct import Struct
from struct import error as StructError  # noqa: N812 - it is a class
from threading import Lock
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol, Self

from eskin.errors import StoreError
from eskin.runtime.digest import checksum
from eskin.runtime.digest import digest as digest_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sqlalchemy import RowMapping

log = logging.getLogger(__name__)

_MOST: Final = 100_000


_FRAME_HEADER: Final = Struct("<9q8s")
_PATCH_ROW_HEADER: Final = Struct("<7q3d8s")


class FrameHeader(NamedTuple):
    """The columns that describe a frame's ``data``, and the digest of ``data``.

    Attributes:
        node: As in `schema.frame_tables.frames`, like all others.
    """

    node: str
    boot: int
    sequence: int
    layout: bytes
    page: int
    t: int
    t_end: int
    error: int
    t_lo: int
    t_hi: int
    samples: int
    digest: bytes

    @property
    def table(self) -> str:
        """The table of such rows."""
        return "frames"

    @classmethod
    def of(cls, row: Mapping[str, Any] | RowMapping) -> Self:
        """The header of a row."""
        return cls(*(row[name] for name in cls._fields))

    @property
    def place(self) -> DamagedRow:
        """The row's key."""
        return DamagedRow(self.node, self.boot, self.sequence)

    def checksum(self) -> int | None:
        """The value of column ``head``; ``None`` if a damaged column has another type."""
        try:
            packed = _FRAME_HEADER.pack(*self[1:3], *self[4:11], self.digest)
            return checksum(b"".join((f"{self.node} ".encode(), packed, self.layout)))
        except (StructError, TypeError):
            return None


class PatchRowHeader(NamedTuple):
    """The columns that describe a compacted row's ``data``, and the digest of ``data``.

    Attributes:
        node: As in `schema.frame_tables.patch_rows`, like all others.
    """

    node: str
    patch: str
    t: int
    boot: int
    sequence: int
    t_end: int
    error: int
    frames: int
    samples: int
    lo: float
    hi: float
    coverage: float
    hash: bytes
    digest: bytes

    @property
    def table(self) -> str:
        """The table of such rows."""
        return "patch_rows"

    @classmethod
    def of(cls, row: Mapping[str, Any] | RowMapping) -> Self:
        """The header of a row."""
        return cls(*(row[name] for name in cls._fields))

    @property
    def place(self) -> DamagedRow:
        """The row's first frame."""
        return DamagedRow(self.node, self.boot, self.sequence, self.frames)

    def checksum(self) -> int | None:
        """The value of column ``head``; ``None`` if a damaged column has another type."""
        try:
            packed = _PATCH_ROW_HEADER.pack(*self[2:12], self.digest)
            return checksum(b"".join((f"{self.node} {self.patch} ".encode(), packed, self.hash)))
        except (StructError, TypeError):
            return None


class DamagedRow(NamedTuple):
    """Key of a damaged row; a compacted row holds ``frames`` frames from this one on."""

    node: str
    boot: int
    sequence: int
    frames: int = 1

    def __str__(self) -> str:
        many = "" if self.frames == 1 else f" and {self.frames - 1} frames compacted with it"
        return f"{self.node} boot {self.boot} sequence {self.sequence}{many}"


class DamagedRowError(StoreError):
    """A row differs from what was written.

    Attributes:
        row: Its key.
    """

    def __init__(self, row: object) -> None:
        self.row = row
        super().__init__(f"{row}: damaged in the store; restore a backup")


class _DamagedRows:
    """The damaged rows that this process has read from its store."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, object], None] = {}
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._known)

    def clear(self) -> None:
        """Forget them: another store is opened."""
        with self._lock:
            self._known.clear()

    def of(self, table: str) -> list[object]:
        """The keys of a table's damaged rows, as far as they were read."""
        with self._lock:
            return [place for other, place in self._known if other == table]

    def note(self, table: str, place: object) -> None:
        """Log a row once."""
        with self._lock:
            if (table, place) in self._known or len(self._known) >= _MOST:
                return
            self._known[table, place] = None
        log.error("row damaged: table=%s row=%s", table, place)


damaged_rows: Final = _DamagedRows()
_current: ContextVar[list[object] | None] = ContextVar("damaged rows", default=None)


@contextmanager
def collect_damaged_rows() -> Iterator[list[object]]:
    """Collect the damaged rows that are read in this context and its threads."""
    found: list[object] = []
    token = _current.set(found)
    try:
        yield found
    finally:
        _current.reset(token)


class RowHeader(Protocol):
    """The columns that describe a row's ``data``."""

    @property
    def table(self) -> str:
        """The table of such rows."""

    @property
    def digest(self) -> bytes:
        """Digest of ``data``."""

    @property
    def place(self) -> DamagedRow:
        """The row's key."""

    def checksum(self) -> int | None:
        """The value of column ``head``; ``None`` if a damaged column has another type."""


def is_intact(head: RowHeader, own: int, data: bytes | None = None) -> bool:
    """Whether a row's header is intact, and its data; a damaged row is reported.

    Args:
        head: The row's header.
        own: Column ``head``.
        data: Column ``data``, if it was read.
    """
    if (data is None or digest_of(data) == head.digest) and head.checksum() == own:
        return True
    report_damaged(head.table, head.place)
    return False


def is_intact_row(
    kind: type[FrameHeader | PatchRowHeader], row: Mapping[str, Any] | RowMapping
) -> bool:
    """Whether a row with the columns of a header, ``head`` and ``data`` is intact."""
    return is_intact(kind.of(row), row["head"], row["data"])


def require_intact(
    kind: type[FrameHeader | PatchRowHeader], row: Mapping[str, Any] | RowMapping
) -> None:
    """Verify the digests of a row, as `is_intact_row` does.

    Raises:
        DamagedRowError: The row is damaged.
    """
    if not is_intact_row(kind, row):
        raise DamagedRowError(kind.of(row).place)


def report_damaged(table: str, place: object) -> None:
    """Log, count and collect a damaged row."""
    damaged_rows.note(table, place)
    found = _current.get()
    if found is not None and place not in found:
        found.append(place)


def are_countable(table: str) -> bool:
    """Whether no row of a table is known to be damaged; known damaged rows are reported.

    A damaged row may count for another node or subject, so counts by these are unknown.
    """
    places = damaged_rows.of(table)
    for place in places:
        report_damaged(table, place)
    return not places


def is_intact_tile(data: bytes, digest: bytes, place: tuple[object, ...]) -> bool:
    """Whether a chunk of tiles is intact; rows are read in place of a damaged one."""
    if digest_of(data) == digest:
        return True
    damaged_rows.note("patch_tiles", place)
    return False
