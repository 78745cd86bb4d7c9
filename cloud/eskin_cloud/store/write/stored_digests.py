"""The digest of each stored message, by node, boot and sequence: told apart from what comes again.

A row holds those of numbers that follow each other. Digests stay when retention removes messages:
numbers do, too.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from operator import itemgetter
from typing import TYPE_CHECKING, Final

from sqlalchemy import and_, or_, select, text

from eskin.runtime.digest import DIGEST_BYTES
from eskin_cloud.store.schema.tables import digests

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sqlalchemy import Connection

_FULL: Final = 64
"""A row of so many digests is written no more: each commit that adds to it writes it whole."""
_LONGEST: Final = 1024
"""Digests of a row, however many come at once."""
_MOST_ASKED: Final = 500
_MOST_OPEN: Final = 10_000
_WRITE: Final = text(
    "INSERT INTO digests (node, boot, first, data) VALUES (:node, :boot, :first, :data) "
    "ON CONFLICT (node, boot, first) DO UPDATE SET data = excluded.data"
)


class StoredDigests:
    """Digests as they are read and added by the writing thread; `save` writes what was added."""

    def __init__(self) -> None:
        self._added: dict[tuple[str, int], dict[int, bytes]] = defaultdict(dict)
        self._open: dict[tuple[str, int], tuple[int, bytes]] = {}
        self._fetched: dict[tuple[str, int], list[tuple[int, bytes]]] = {}

    def added(self, node: str, boot: int) -> dict[int, bytes]:
        """By number, those of messages that are stored for the first time: add to them."""
        return self._added[node, boot]

    def fetch(
        self, connection: Connection, spans: Mapping[tuple[str, int], tuple[int, int]]
    ) -> None:
        """Read at once what `find` will be asked for.

        Args:
            connection: The writing thread's.
            spans: Of nodes and their boots, the least and the greatest number.
        """
        d, places = digests.c, list(spans)
        query = select(d.node, d.boot, d.first, d.data).order_by(d.first)
        self._fetched = {}
        for begin in range(0, len(places), _MOST_ASKED):
            wanted = [
                and_(d.node == node, d.boot == boot, d.first > least - _LONGEST, d.first <= most)
                for node, boot in places[begin : begin + _MOST_ASKED]
                for least, most in [spans[node, boot]]
            ]
            for node, boot, first, data in connection.execute(query.where(or_(*wanted))):
                self._fetched.setdefault((node, boot), []).append((first, data))

    def find(self, connection: Connection, node: str, boot: int, sequence: int) -> bytes | None:
        """The digest of a stored message; ``None`` where the store has lost it."""
        added = self._added[node, boot].get(sequence)
        if added is not None:
            return added
        fetched = self._fetched.get((node, boot), [])
        at = bisect_right(fetched, sequence, key=itemgetter(0))
        known = _within(*fetched[at - 1], sequence) if at else None
        return known or find_digest(connection, node, boot, sequence)

    def save(self, connection: Connection) -> None:
        """Write what was added, and go on adding to a boot's last row while it is not full."""
        self._fetched = {}
        rows = []
        for (node, boot), added in self._added.items():
            for first, data in self._joined((node, boot), added):
                rows.append({"node": node, "boot": boot, "first": first, "data": data})
        self._added.clear()
        if rows:
            connection.execute(_WRITE, rows)
        if len(self._open) > _MOST_OPEN:
            self._open.clear()

    def _joined(
        self, place: tuple[str, int], added: Mapping[int, bytes]
    ) -> Iterator[tuple[int, bytes]]:
        """Rows of a boot, with the digests that were added."""
        for numbers in _stretches(sorted(added)):
            first, data = self._open.get(place, (0, b""))
            if first + len(data) // DIGEST_BYTES != numbers[0]:
                first, data = numbers[0], b""
            data += b"".join(map(added.__getitem__, numbers))
            yield first, data
            if len(data) < _FULL * DIGEST_BYTES:
                self._open[place] = first, data
            else:
                self._open.pop(place, None)


def find_digest(connection: Connection, node: str, boot: int, sequence: int) -> bytes | None:
    """The digest of a stored message; ``None`` where the store has none."""
    d = digests.c
    query = select(d.first, d.data).where(d.node == node, d.boot == boot, d.first <= sequence)
    standing = connection.execute(query.order_by(d.first.desc()).limit(1)).first()
    return None if standing is None else _within(standing.first, standing.data, sequence)


def _stretches(numbers: Sequence[int]) -> Iterator[Sequence[int]]:
    """Parts of sorted numbers, each without a hole and short enough for a row that is not full."""
    begin = 0
    for end in range(1, len(numbers) + 1):
        if (
            end == len(numbers)
            or numbers[end] != numbers[end - 1] + 1
            or end - begin == _LONGEST - _FULL
        ):
            yield numbers[begin:end]
            begin = end


def _within(first: int, row: bytes, sequence: int) -> bytes | None:
    """A number's digest in a row; ``None`` where the row ends before it."""
    at = (sequence - first) * DIGEST_BYTES
    return row[at : at + DIGEST_BYTES] if 0 <= at < len(row) else None
