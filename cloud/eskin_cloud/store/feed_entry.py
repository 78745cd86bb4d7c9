"""Entries of the live feed, and positions in it: how far each slot has been read."""

from __future__ import annotations

from dataclasses import dataclass
from operator import ge
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

from sqlalchemy import select, update

from eskin.wire.slot import SLOTS, slot_of_cursor
from eskin_cloud.store.schema.tables import feed

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sqlalchemy import Connection


_SLOT_NUMBERS: Final = sum(range(SLOTS))


class FeedSpan(NamedTuple):
    """Entries of one slot.

    Attributes:
        slot: The slot.
        after: The cursor before them.
        end: The cursor of the last one.
    """

    slot: int
    after: int
    end: int

    @property
    def size(self) -> int:
        """The number of cursors."""
        return (self.end - self.after) // SLOTS


@dataclass(frozen=True, slots=True)
class FeedPosition:
    """A position in the feed: entries up to it have been read, slot by slot.

    Cursors are ordered within a slot only: writers of different slots commit in any order.

    Attributes:
        cursors: The last cursor of each slot, by its number.
    """

    cursors: tuple[int, ...]

    @classmethod
    def of(cls, numbers: Iterable[int]) -> Self:
        """The position at which so many cursors of each slot have been read."""
        return cls(tuple(number * SLOTS + slot for slot, number in enumerate(numbers)))

    def __contains__(self, cursor: int) -> bool:
        """Whether an entry has been read."""
        return cursor <= self.cursors[slot_of_cursor(cursor)]

    def advance(self, cursors: Iterable[int]) -> FeedPosition:
        """The position after more entries."""
        reached = list(self.cursors)
        for cursor in cursors:
            slot = slot_of_cursor(cursor)
            reached[slot] = max(reached[slot], cursor)
        return FeedPosition(tuple(reached))

    def spans(self, end: FeedPosition) -> Iterator[FeedSpan]:
        """What lies between this position and a later one, in the slots in which it is later."""
        for slot, (ours, theirs) in enumerate(zip(self.cursors, end.cursors, strict=True)):
            if theirs > ours:
                yield FeedSpan(slot, ours, theirs)

    def reaches(self, other: FeedPosition) -> bool:
        """Whether this position is in no slot earlier than another."""
        return all(map(ge, self.cursors, other.cursors))

    def distance(self, end: FeedPosition) -> int:
        """How many cursors lie between this position and one that reaches it."""
        return end.total - self.total

    @property
    def total(self) -> int:
        """How many cursors have been read."""
        return (sum(self.cursors) - _SLOT_NUMBERS) // SLOTS

    def no_later_than(self, end: FeedPosition) -> FeedPosition:
        """This position, in no slot later than another."""
        return FeedPosition(tuple(map(min, self.cursors, end.cursors)))

    def resume(self, end: FeedPosition, most: int) -> FeedPosition:
        """The position from which at most ``most`` cursors are left until ``end``."""
        spans = list(self.spans(end))
        kept = share(most, [span.size for span in spans])
        return self.advance(span.end - size * SLOTS for span, size in zip(spans, kept, strict=True))


def share(most: int, sizes: Sequence[int]) -> list[int]:
    """Shares of ``most``, none larger than its size: small sizes in full, the others evenly."""
    shares, left = [0] * len(sizes), most
    for done, number in enumerate(sorted(range(len(sizes)), key=sizes.__getitem__)):
        shares[number] = min(sizes[number], left // (len(sizes) - done))
        left -= shares[number]
    return shares


FEED_START: Final = FeedPosition.of([0] * SLOTS)
"""Before the first entry."""


def last_position(connection: Connection) -> FeedPosition:
    """The position at which all has been read."""
    rows = connection.execute(select(feed.c.cursor).order_by(feed.c.slot)).scalars()
    return FeedPosition(tuple(rows))


def compacted_position(connection: Connection, spans: Iterable[FeedSpan]) -> FeedPosition:
    """The position up to which frames of spans may have been compacted or removed.

    Args:
        connection: In a read transaction, after the entries of the spans were read.
        spans: What was read.

    Returns:
        The start in the slots in which none was.
    """
    after = {span.slot: span.after for span in spans}
    query = select(feed.c.slot, feed.c.compacted).where(feed.c.slot.in_(sorted(after)))
    found = connection.execute(query).all()
    return FEED_START.advance(compacted for slot, compacted in found if compacted > after[slot])


def note_compacted(connection: Connection, cursor: int) -> None:
    """Note that a frame, and others before it in its slot, are not in the feed any more.

    Args:
        connection: The writer's, in a transaction that locks the slot.
        cursor: That of the frame.
    """
    here = feed.c.slot == slot_of_cursor(cursor)
    raised = update(feed).where(here, feed.c.compacted < cursor).values(compacted=cursor)
    connection.execute(raised)


class FeedEntry(NamedTuple):
    """A stored frame or event, with its cursor; a tuple, because there are many.

    Attributes:
        cursor: Position in the feed; it grows with each message.
        node: The node.
        channel: The channel of a peak; ``None`` for anything else.
        event: The event's row; ``None`` for a frame.
        received: When the cloud stored it, UTC ns.
        sealed: A sealed message; ``event`` and ``frame`` are then ``None``.
        frame: The frame's bytes; ``None`` for anything else.
        layout: Hash of the layout by which the frame, or what is sealed, is read.
        secret: Whether the frame was opened for one client: no cache may keep it.
    """

    cursor: int
    node: str
    channel: str | None
    event: dict[str, Any] | None
    received: int
    sealed: bytes | None = None
    frame: bytes | None = None
    layout: bytes | None = None
    secret: bool = False

    @property
    def size(self) -> int:
        """Bytes of the message."""
        body = self.frame or self.sealed
        if body is None and self.event is not None:
            body = self.event.get("data")
        return len(body or b"")
