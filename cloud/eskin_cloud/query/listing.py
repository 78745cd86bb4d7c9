"""List nodes and channels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import func, or_, select, union

from eskin.privacy.sealed_message import read_page
from eskin.wire.biometric import BIOMETRIC, MARK
from eskin_cloud.query.cursors import read_texts, write_cursor
from eskin_cloud.store.damage import DamagedRowError, are_countable
from eskin_cloud.store.descriptions import UnknownDescriptionError, find_layout
from eskin_cloud.store.read.patch_columns import describe_columns
from eskin_cloud.store.read.patch_runs import find_layouts
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.frame_tables import descriptions, pages, patches
from eskin_cloud.store.schema.sealed_tables import removals
from eskin_cloud.store.schema.tables import channels, nodes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Column, ColumnElement, Connection, RowMapping

    from eskin.wire.frames import Patch
    from eskin_cloud.store.read.lookup import Channel

_PAGE: Final = 1000


def list_nodes(
    connection: Connection, cursor: str | None
) -> tuple[Sequence[RowMapping], str | None]:
    """One page of nodes, by name, and the cursor of the next.

    Raises:
        QueryError: The cursor is invalid.
    """
    return _page(connection, nodes.c.node, cursor)


def list_channels(
    connection: Connection,
    node: str,
    cursor: str | None,
    *,
    quantity: str | None = None,
    text: str | None = None,
) -> tuple[list[Channel], str | None]:
    """One page of a node's channels, by name, and the cursor of the next.

    Args:
        connection: In a read transaction.
        node: The node.
        cursor: The cursor of an earlier page.
        quantity: Whose channels are listed; else those of all.
        text: What a channel's name contains, in upper or lower case.

    Raises:
        QueryError: The cursor is invalid.
    """
    c = channels.c.channel
    here = [channels.c.node == node]
    here += [] if quantity is None else [c.endswith(f".{quantity}", autoescape=True)]
    here += [] if text is None else [func.lower(c).contains(text.lower(), autoescape=True)]
    listed, following = _page(connection, c, cursor, *here)
    after = "" if cursor is None else read_texts(cursor, 1)[0]
    found: dict[str, Channel | None] = {row["channel"]: row for row in listed}
    end = None if following is None else read_texts(following, 1)[0]
    columns = _columns(connection, node)
    for name in columns:
        chosen = after < name and (end is None or name <= end)
        if quantity is not None:
            chosen &= name.endswith(f".{quantity}")
        if chosen and (text is None or text.lower() in name.lower()):
            found.setdefault(name, None)
    names = sorted(found)
    if len(names) > _PAGE:
        names, following = names[:_PAGE], write_cursor(names[_PAGE - 1])
    described: dict[str, list[dict[str, Any]]] = {}
    page: list[Channel] = []
    for name in names:
        row = found[name]
        if row is None:
            patch, column = columns[name]
            if patch.patch_id not in described:
                described[patch.patch_id] = _describe(connection, node, patch)
            if not described[patch.patch_id]:
                continue
            row = described[patch.patch_id][column]
        page.append(row)
    return page, following


def _describe(connection: Connection, node: str, patch: Patch) -> list[dict[str, Any]]:
    """All channels of a patch; none if its totals are damaged, which is reported.

    Where totals are damaged that may be those of this patch, the first and the last sample are
    unknown.
    """
    counted = are_countable(pages.name) and are_countable(patches.name)
    try:
        found = describe_columns(connection, node, patch)
    except DamagedRowError:
        return []
    if counted:
        return found
    unknown = {"t_first": None, "t_last": None}
    return [row | unknown for row in found if row["t_last"] is not None]


def _columns(connection: Connection, node: str) -> dict[str, tuple[Patch, int]]:
    """The channels of a node's frames: of each the latest description, and its column."""
    return {
        channel: (described.patches[number], column)
        for described in reversed(find_layouts(connection, node))
        for channel, (number, column) in described.places.items()
    }


def count_channels(connection: Connection, names: Sequence[str]) -> dict[str, int | None]:
    """The number of channels of each node; ``None`` if rows of channels are damaged."""
    if not are_countable(channels.name):
        return dict.fromkeys(names)
    query = select(channels.c.node, func.count()).where(channels.c.node.in_(names))
    counted = connection.execute(query.group_by(channels.c.node))
    found = {**dict.fromkeys(names, 0), **{row[0]: row[1] for row in counted}}
    with_layout = select(nodes.c.node).where(nodes.c.node.in_(names), nodes.c.layout.is_not(None))
    for node in connection.execute(with_layout).scalars().all():
        here = channels.c.node == node
        others = connection.execute(select(channels.c.channel).where(here)).scalars()
        found[node] = len(set(others) | set(_columns(connection, node)))
    return found


def sealed_nodes(connection: Connection, names: Sequence[str] | None = None) -> set[str]:
    """The nodes, of ``names`` or of all, that have a biometric channel."""
    c, d = channels.c, descriptions.c
    named = or_(c.channel.like(f"{MARK}%"), *(c.channel.like(f"%.{q}") for q in BIOMETRIC))
    of_channels = select(c.node).distinct().where(named)
    of_frames = select(d.node).distinct().where(d.biometric == 1)
    if names is not None:
        of_channels = of_channels.where(c.node.in_(names))
        of_frames = of_frames.where(d.node.in_(names))
    return set(connection.execute(union(of_channels, of_frames)).scalars())


def list_removed(connection: Connection, node: str) -> dict[str, tuple[int, int]]:
    """The number of removed messages of each channel or patch, and before when, UTC ns."""
    rows = connection.execute(select(removals).where(removals.c.node == node)).mappings()
    found: dict[str, tuple[int, int]] = {}
    for row in intact_rows(connection, removals, rows):
        for name in _removed_names(connection, node, row["channel"]):
            messages, before = found.get(name, (0, row["before"]))
            found[name] = messages + row["messages"], max(before, row["before"])
    return found


def _removed_names(connection: Connection, node: str, place: str) -> list[str]:
    """The channel or patch of which something was removed; of sealed frames, all patches."""
    page = read_page(place)
    if page is None:
        return [place]
    try:
        described = find_layout(connection, node, page[0])
    except UnknownDescriptionError:  # damaged, and reported
        return []
    return [described.patches[number].patch_id for number in described.page_ranges[page[1]]]


def _page(
    connection: Connection,
    name: Column[str],
    cursor: str | None,
    *where: ColumnElement[bool],
) -> tuple[Sequence[RowMapping], str | None]:
    query = select(name.table).where(*where).order_by(name).limit(_PAGE + 1)
    if cursor is not None:
        query = query.where(name > read_texts(cursor, 1)[0])
    found = connection.execute(query).mappings().all()
    page = intact_rows(connection, name.table, found[:_PAGE])
    if len(found) <= _PAGE:
        return page, None
    return page, write_cursor(found[_PAGE - 1][name])
