"""Detect duplicates: the sequence numbers of stored messages, and the messages' digests.

A known number with the stored digest is a duplicate, with another digest a conflict. A row holds
the digests of consecutive sequence numbers. Retention keeps digests and numbers.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from operator import itemgetter
from typing import TYPE_CHECKING, Final, NamedTuple

from sqlalchemy import and_, func, or_, select, text

from eskin.runtime.digest import DIGEST_BYTES
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.slot import slot_of
from eskin_cloud.store.key_batches import key_batches
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import digests

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from sqlalchemy import Connection

MAX_RANGES: Final = 100_000
"""Of a boot: each range costs a row and memory. Honest nodes skip numbers only for losses."""
_FULL_ROW: Final = 64
"""A row with so many digests is not extended: each extension rewrites the row."""
_MAX_ROW: Final = 1024
"""Most digests of a row."""
_MOST_ASKED: Final = 500
_MAX_OPEN_ROWS: Final = 10_000
_WRITE: Final = text(
    "INSERT INTO digests (slot, node, boot, first, data) "
    "VALUES (:slot, :node, :boot, :first, :data) "
    "ON CONFLICT (slot, node, boot, first) DO UPDATE SET data = excluded.data"
)


class RangeChange(NamedTuple):
    """A range that changed since the last write.

    Attributes:
        first: Its first number.
        before: Its last number as written; ``None`` for a new range.
        now: Its last number now; ``None`` if it was merged into another range.
    """

    first: int
    before: int | None
    now: int | None


class StoredSequences(SequenceRanges):
    """Ranges that record their changes, so that a save writes only these.

    Args:
        ranges: The stored ranges.
    """

    def __init__(self, ranges: Iterable[tuple[int, int]] = ()) -> None:
        self._before: dict[int, int | None] = {}
        super().__init__(ranges)
        self._before.clear()

    def add(self, first: int, last: int | None = None) -> None:
        """Add one number, or all from ``first`` to ``last``.

        Raises:
            ValueError: ``first > last``.
        """
        if not self._lasts or first != self._lasts[-1] + 1:
            for known in self.near(first, first if last is None else last):
                self._before.setdefault(*known)
            self._before.setdefault(first, None)
        else:  # the usual case: numbers arrive in order
            self._before.setdefault(self._firsts[-1], self._lasts[-1])
        super().add(first, last)

    def has_room_for(self, number: int) -> bool:
        """Whether a number may be added without exceeding `MAX_RANGES`."""
        return len(self) < MAX_RANGES or bool(self.near(number, number))

    def changes(self) -> Iterator[RangeChange]:
        """The changes to write."""
        for first, before in self._before.items():
            now = self.last_of(first)
            if now != before:
                yield RangeChange(first, before, now)

    def written(self) -> None:
        """Forget the changes, which are written."""
        self._before.clear()


class StoredDigests:
    """Digests as the writer thread reads and adds them; `save` writes added ones."""

    def __init__(self) -> None:
        self._added: dict[tuple[str, int], dict[int, bytes]] = defaultdict(dict)
        self._open: defaultdict[int, dict[tuple[str, int], tuple[int, bytes]]] = defaultdict(dict)
        self._fetched: dict[tuple[str, int], list[tuple[int, bytes]]] = {}

    def added(self, node: str, boot: int) -> dict[int, bytes]:
        """The new digests of a boot by sequence number; the caller adds to them."""
        return self._added[node, boot]

    def fetch(
        self, connection: Connection, spans: Mapping[tuple[str, int], tuple[int, int]]
    ) -> None:
        """Read the digests that `find` will need, in few statements.

        Args:
            connection: The writer's.
            spans: The least and the greatest sequence number, by node and boot.
        """
        d, places = digests.c, list(spans)
        query = select(d.node, d.boot, d.first, d.data).order_by(d.first)
        self._fetched = {}
        for batch in key_batches(places, _MOST_ASKED):
            wanted = [
                and_(
                    of_node(digests, node),
                    d.boot == boot,
                    d.first > least - _MAX_ROW,
                    d.first <= most,
                )
                for node, boot in batch
                for least, most in [spans[node, boot]]
            ]
            for node, boot, first, data in connection.execute(query.where(or_(*wanted))):
                self._fetched.setdefault((node, boot), []).append((first, data))

    def find(self, connection: Connection, node: str, boot: int, sequence: int) -> bytes | None:
        """The digest of a stored message; ``None`` if it is missing."""
        added = self._added[node, boot].get(sequence)
        if added is not None:
            return added
        fetched = self._fetched.get((node, boot), [])
        at = bisect_right(fetched, sequence, key=itemgetter(0))
        known = _within(*fetched[at - 1], sequence) if at else None
        return known or find_digest(connection, node, boot, sequence)

    def save(self, connection: Connection) -> None:
        """Write added digests; a boot's last row is extended until it is full."""
        self._fetched = {}
        rows = []
        for (node, boot), added in self._added.items():
            for first, data in self._joined((node, boot), added):
                place = {"slot": slot_of(node), "node": node, "boot": boot}
                rows.append(place | {"first": first, "data": data})
        self._added.clear()
        if rows:
            connection.execute(_WRITE, rows)
        if sum(map(len, self._open.values())) > _MAX_OPEN_ROWS:
            self._open.clear()

    def forget(self, slot: int) -> None:
        """Drop what is cached of a slot, which another process has written."""
        self._open.pop(slot, None)

    def _joined(
        self, place: tuple[str, int], added: Mapping[int, bytes]
    ) -> Iterator[tuple[int, bytes]]:
        """The rows of a boot that hold the added digests."""
        extended = self._open[slot_of(place[0])]
        for numbers in _consecutive(sorted(added)):
            first, data = extended.get(place, (0, b""))
            if first + len(data) // DIGEST_BYTES != numbers[0]:
                first, data = numbers[0], b""
            data += b"".join(map(added.__getitem__, numbers))
            yield first, data
            if len(data) < _FULL_ROW * DIGEST_BYTES:
                extended[place] = first, data
            else:
                extended.pop(place, None)


def find_digest(connection: Connection, node: str, boot: int, sequence: int) -> bytes | None:
    """The digest of a stored message; ``None`` if there is none."""
    d = digests.c
    query = select(d.first, d.data).where(
        of_node(digests, node), d.boot == boot, d.first <= sequence
    )
    standing = connection.execute(query.order_by(d.first.desc()).limit(1)).first()
    return None if standing is None else _within(standing.first, standing.data, sequence)


def stored_spans(connection: Connection, node: str, boot: int) -> Iterator[tuple[int, int]]:
    """The first and the last stored number of each row of a boot, in order."""
    d = digests.c
    query = select(d.first, func.length(d.data)).where(of_node(digests, node), d.boot == boot)
    for first, size in connection.execute(query.order_by(d.first)):
        yield first, first + size // DIGEST_BYTES - 1


def _consecutive(numbers: Sequence[int]) -> Iterator[Sequence[int]]:
    """Runs of consecutive numbers, each short enough for a row that is not full."""
    begin = 0
    for end in range(1, len(numbers) + 1):
        if (
            end == len(numbers)
            or numbers[end] != numbers[end - 1] + 1
            or end - begin == _MAX_ROW - _FULL_ROW
        ):
            yield numbers[begin:end]
            begin = end


def _within(first: int, row: bytes, sequence: int) -> bytes | None:
    """A number's digest in a row; ``None`` if the row ends before it."""
    at = (sequence - first) * DIGEST_BYTES
    return row[at : at + DIGEST_BYTES] if 0 <= at < len(row) else None
