"""The digest of each stored message, by node, boot and sequence: told apart from what comes again.

A row holds those of numbers that follow each other. Digests stay when retention removes messages:
numbers do, too.
"""

from __future__ import annotations

from bisect import bisect_right
from operator import itemgetter
from typing import TYPE_CHECKING, Final

from sqlalchemy import and_, or_, select, text

from cloud.store.digest import DIGEST_BYTES
from cloud.store.schema import digests

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sqlalchemy import Connection

_FULL: Final = 64 * DIGEST_BYTES
"""A row of so many bytes is written no more: each commit that adds to it writes it whole."""
_LONGEST: Final = 1024 * DIGEST_BYTES
"""Of a row, however many come at once."""
_MOST_ASKED: Final = 500
_MOST_OPEN: Final = 10_000
_WRITE: Final = text(
    "INSERT INTO digests (node, boot, first, data) VALUES (:node, :boot, :first, :data) "
    "ON CONFLICT (node, boot, first) DO UPDATE SET data = excluded.data"
)


class StoredDigests:
    """Digests as they are read and added by the writing thread; `save` writes what was added."""

    def __init__(self) -> None:
        self._rows: dict[tuple[str, int], dict[int, bytearray]] = {}
        self._last: dict[tuple[str, int], int] = {}
        self._changed: dict[tuple[str, int, int], bytearray] = {}
        self._fetched: dict[tuple[str, int], list[tuple[int, bytes]]] = {}

    def add(self, node: str, boot: int, sequence: int, digest: bytes) -> None:
        """Remember the digest of a message that is stored for the first time."""
        place = node, boot
        first = self._last.get(place)
        row = None if first is None else self._rows[place][first]
        if (
            first is None
            or row is None
            or sequence != first + len(row) // DIGEST_BYTES
            or (len(row) >= _LONGEST)
        ):
            self._last[place], first, row = sequence, sequence, bytearray()
            self._rows.setdefault(place, {})[sequence] = row
        row += digest
        self._changed[node, boot, first] = row

    def fetch(
        self, connection: Connection, spans: Mapping[tuple[str, int], tuple[int, int]]
    ) -> None:
        """Read at once what `find` will be asked for.

        Args:
            connection: The writing thread's.
            spans: Of nodes and their boots, the least and the greatest number.
        """
        d, places = digests.c, list(spans)
        longest = _LONGEST // DIGEST_BYTES
        query = select(d.node, d.boot, d.first, d.data).order_by(d.first)
        self._fetched = {}
        for begin in range(0, len(places), _MOST_ASKED):
            wanted = [
                and_(d.node == node, d.boot == boot, d.first > least - longest, d.first <= most)
                for node, boot in places[begin : begin + _MOST_ASKED]
                for least, most in [spans[node, boot]]
            ]
            for node, boot, first, data in connection.execute(query.where(or_(*wanted))):
                self._fetched.setdefault((node, boot), []).append((first, data))

    def find(self, connection: Connection, node: str, boot: int, sequence: int) -> bytes | None:
        """The digest of a stored message; ``None`` where the store has lost it."""
        for first, row in self._rows.get((node, boot), {}).items():
            found = _within(first, row, sequence)
            if found is not None:
                return found
        fetched = self._fetched.get((node, boot), [])
        at = bisect_right(fetched, sequence, key=itemgetter(0))
        known = _within(*fetched[at - 1], sequence) if at else None
        return known or find_digest(connection, node, boot, sequence)

    def save(self, connection: Connection) -> None:
        """Write what was added, and go on adding to rows that are not full."""
        self._fetched = {}
        if not self._changed:
            return
        rows = [
            {"node": node, "boot": boot, "first": first, "data": bytes(row)}
            for (node, boot, first), row in self._changed.items()
        ]
        connection.execute(_WRITE, rows)
        for node, boot, _ in self._changed:
            place = node, boot
            first = self._last.get(place)
            standing = self._rows.pop(place, {})
            if first is not None and len(standing[first]) < _FULL:
                self._rows[place] = {first: standing[first]}
            else:
                self._last.pop(place, None)
        self._changed.clear()
        if len(self._last) > _MOST_OPEN:
            self._rows.clear()
            self._last.clear()


def find_digest(connection: Connection, node: str, boot: int, sequence: int) -> bytes | None:
    """The digest of a stored message; ``None`` where the store has none."""
    d = digests.c
    query = select(d.first, d.data).where(d.node == node, d.boot == boot, d.first <= sequence)
    standing = connection.execute(query.order_by(d.first.desc()).limit(1)).first()
    return None if standing is None else _within(standing.first, standing.data, sequence)


def _within(first: int, row: bytes | bytearray, sequence: int) -> bytes | None:
    """A number's digest in a row; ``None`` where the row ends before it."""
    at = (sequence - first) * DIGEST_BYTES
    return bytes(row[at : at + DIGEST_BYTES]) if 0 <= at < len(row) else None
