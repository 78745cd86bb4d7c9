"""Sealed events: opened in order of their minutes, until a page is sure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sqlalchemy import select

from eskin.errors import NoKeyError
from eskin.wire.frames import Statements
from eskin_cloud.privacy.sealed_rows import event_rows, open_row
from eskin_cloud.query.events import place
from eskin_cloud.store.descriptions import UnknownDescriptionError, find_layout
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.sealed_tables import sealed_messages

if TYPE_CHECKING:
    from sqlalchemy import Connection, RowMapping, Select

    from eskin_cloud.privacy.sealed_rows import SealedReader
    from eskin_cloud.query.events import EventQuery


def find_sealed_events(
    connection: Connection, reader: SealedReader, question: EventQuery
) -> list[dict[str, Any]]:
    """The first sealed events that answer a question, in its order; one more than its limit.

    Several may come from one message, and share its cursor; ``number`` counts them.

    Raises:
        PrivacyError: Something was changed on the disk.
    """
    if question.kind not in {None, "peak", "contact", "verdict"} or question.is_of_no_time:
        return []
    rising = question.order == "asc"
    after = question.cursor
    found: list[dict[str, Any]] = []
    for row in connection.execute(_select(question, after)).mappings():
        if len(found) > question.limit and _sure(found, question.limit, row, rising=rising):
            break
        events = _open(connection, reader, row)
        found += [event for event in events if _answers(question, event, after)]
        found.sort(key=place, reverse=not rising)
        del found[question.limit + 1 :]
    return found


def _select(question: EventQuery, after: tuple[int, ...] | None) -> Select[tuple[object, ...]]:
    v = sealed_messages.c
    query: Select[tuple[object, ...]] = select(sealed_messages)
    query = query.where(v.kind == "statements")
    if question.node is not None:
        query = query.where(of_node(sealed_messages, question.node))
    if question.start is not None:
        query = query.where(v.t_hi >= question.start)
    if question.end is not None:
        query = query.where(v.t_lo < question.end)
    if question.order == "asc":
        query = query if after is None else query.where(v.t_hi >= after[0])
        return query.order_by(v.t_lo, v.cursor)
    query = query if after is None else query.where(v.t_lo <= after[0])
    return query.order_by(v.t_hi.desc(), v.cursor.desc())


def _sure(found: list[dict[str, Any]], limit: int, row: RowMapping, *, rising: bool) -> bool:
    """Whether no later row can come before the last of the page."""
    last: int = found[limit]["t_lo"]
    return bool(row["t_lo"] > last if rising else row["t_hi"] < last)


def _open(connection: Connection, reader: SealedReader, row: RowMapping) -> list[dict[str, Any]]:
    try:
        opened = open_row(reader, row)
    except NoKeyError:
        return []
    if opened is None:
        return []
    message, data = opened
    if not isinstance(message, Statements):
        return []
    try:
        described = find_layout(connection, row["node"], message.layout)
    except UnknownDescriptionError:  # damaged, and reported
        return []
    return event_rows(row["node"], message, data, described, row["cursor"])


def _answers(question: EventQuery, event: dict[str, Any], after: tuple[int, ...] | None) -> bool:
    if after is not None:
        beyond = place(event) > after if question.order == "asc" else place(event) < after
        if not beyond:
            return False
    return (
        (question.kind is None or event["kind"] == question.kind)
        and (question.channel is None or event["channel"] == question.channel)
        and (question.verdict is None or event["verdict"] == question.verdict)
        and (question.start is None or event["t_hi"] >= question.start)
        and (question.end is None or event["t_lo"] < question.end)
    )
