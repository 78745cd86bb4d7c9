"""Query events: peaks, gaps and changes of a node's status."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from sqlalchemy import false, select, tuple_

from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import events

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection, RowMapping, Select

    from eskin_cloud.store.write.write_cache import Row


@dataclass(frozen=True, slots=True)
class EventQuery:
    """A query of events.

    Attributes:
        node: Of this node only.
        channel: Of this channel only.
        kind: Of this kind only.
        verdict: With this verdict only.
        start: Events that end before it, UTC ns, are left out.
        end: Events that begin at or after it, UTC ns, are left out.
        limit: Most events.
        cursor: Continue after this event: its `place`.
        order: By time; ``desc`` gives the latest first.
    """

    node: str | None
    channel: str | None
    kind: str | None
    verdict: str | None
    start: int | None
    end: int | None
    limit: int
    cursor: tuple[int, int, int] | None
    order: Literal["asc", "desc"]

    @property
    def is_of_no_time(self) -> bool:
        """Whether the window is empty; no event overlaps it."""
        return self.start is not None and self.start == self.end


def find_events(
    connection: Connection, question: EventQuery, opened: Sequence[Row] = ()
) -> tuple[list[RowMapping | Row], tuple[int, int, int] | None]:
    """One page of events, and the cursor of the next.

    Args:
        connection: In a read transaction.
        question: The query.
        opened: The first decrypted events that match the query, in its order.
    """
    found: list[RowMapping | Row] = [*connection.execute(_select(question)).mappings(), *opened]
    if opened:
        found.sort(key=place, reverse=question.order == "desc")
    more, page = len(found) > question.limit, found[: question.limit]
    following = place(page[-1]) if more else None
    of_people = {id(row) for row in opened}
    stored = {
        id(row)
        for row in intact_rows(connection, events, (r for r in page if id(r) not in of_people))
    }
    return [row for row in page if id(row) in stored or id(row) in of_people], following


def place(event: RowMapping | Row) -> tuple[int, int, int]:
    """An event's place in the order of events; those of one sealed message are numbered."""
    return event["t_lo"], event["cursor"], event.get("number", 0)


def _select(question: EventQuery) -> Select[tuple[object, ...]]:
    e = events.c
    query: Select[tuple[object, ...]] = select(events)
    for column, value in (
        (e.channel, question.channel),
        (e.kind, question.kind),
        (e.verdict, question.verdict),
    ):
        if value is not None:
            query = query.where(column == value)
    if question.node is not None:
        query = query.where(of_node(events, question.node))
    if question.is_of_no_time:
        query = query.where(false())
    if question.start is not None:
        query = query.where(e.t_hi >= question.start)
    if question.end is not None:
        query = query.where(e.t_lo < question.end)
    if question.cursor is not None:
        here, after = tuple_(e.t_lo, e.cursor), tuple_(*question.cursor[:2])
        query = query.where(here > after if question.order == "asc" else here < after)
    if question.order == "asc":
        query = query.order_by(e.t_lo, e.cursor)
    else:
        query = query.order_by(e.t_lo.desc(), e.cursor.desc())
    return query.limit(question.limit + 1)
