"""List nodes and channels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import select, union

from eskin.privacy.sealed_message import read_page
from eskin_cloud.store.damage import DamagedRowError, are_countable
from eskin_cloud.store.descriptions import UnknownDescriptionError, find_layout
from eskin_cloud.store.read.patch_columns import describe_columns
from eskin_cloud.store.read.patch_runs import find_layouts
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.frame_tables import descriptions, pages, patches
from eskin_cloud.store.schema.node_key import of_node, of_nodes
from eskin_cloud.store.schema.sealed_tables import removals
from eskin_cloud.store.schema.tables import nodes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection, RowMapping

    from eskin.wire.frames import Patch
    from eskin_cloud.store.read.lookup import Channel

_PAGE: Final = 1000


def list_nodes(connection: Connection, after: str) -> tuple[Sequence[RowMapping], str | None]:
    """The nodes after a name, one page of them, and the name after which the next begins."""
    name = nodes.c.node
    query = select(nodes).where(name > after).order_by(name).limit(_PAGE + 1)
    found = connection.execute(query).mappings().all()
    page = intact_rows(connection, nodes, found[:_PAGE])
    return page, found[_PAGE - 1]["node"] if len(found) > _PAGE else None


def list_channels(
    connection: Connection,
    node: str,
    after: str,
    *,
    quantity: str | None = None,
    text: str | None = None,
) -> tuple[list[Channel], str | None]:
    """A node's channels after a name, one page, and the name after which the next begins.

    Args:
        connection: In a read transaction.
        node: The node.
        after: The last name of the page before; empty at first.
        quantity: Whose channels are listed; else those of all.
        text: What a channel's name contains, in upper or lower case.
    """
    columns = _columns(connection, node)
    names = sorted(
        name
        for name in columns
        if name > after
        and (quantity is None or name.endswith(f".{quantity}"))
        and (text is None or text.lower() in name.lower())
    )
    following = names[_PAGE - 1] if len(names) > _PAGE else None
    described: dict[str, list[Channel]] = {}
    page: list[Channel] = []
    for name in names[:_PAGE]:
        patch, column = columns[name]
        if patch.patch_id not in described:
            described[patch.patch_id] = _describe(connection, node, patch)
        if described[patch.patch_id]:
            page.append(described[patch.patch_id][column])
    return page, following


def _describe(connection: Connection, node: str, patch: Patch) -> list[Channel]:
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
    """A node's channels: of each the latest description of its patch, and its column."""
    return {
        channel: (described.patches[number], column)
        for described in reversed(find_layouts(connection, node))
        for channel, (number, column) in described.places.items()
    }


def count_channels(connection: Connection, names: Sequence[str]) -> dict[str, int | None]:
    """The number of channels of each node; ``None`` where a layout or totals are damaged."""
    if not are_countable(pages.name):
        return dict.fromkeys(names)
    n, p = nodes.c, pages.c
    latest = select(n.node, n.layout).where(of_nodes(nodes, names), n.layout.is_not(None))
    earlier = select(p.node, p.layout).where(of_nodes(pages, names))
    layouts: dict[str, list[bytes]] = {name: [] for name in names}
    for node, layout in connection.execute(union(latest, earlier)):
        layouts[node].append(bytes(layout))
    return {node: _count(connection, node, layouts[node]) for node in names}


def _count(connection: Connection, node: str, layouts: Sequence[bytes]) -> int | None:
    """The number of channels in some layouts of a node."""
    try:
        described = [find_layout(connection, node, layout) for layout in layouts]
    except UnknownDescriptionError:  # damaged, and reported
        return None
    return len({channel for each in described for channel in each.places})


def sealed_nodes(connection: Connection, names: Sequence[str] | None = None) -> set[str]:
    """The nodes, of ``names`` or of all, that have a biometric channel."""
    d = descriptions.c
    query = select(d.node).distinct().where(d.biometric == 1)
    if names is not None:
        query = query.where(of_nodes(descriptions, names))
    return set(connection.execute(query).scalars())


def list_removed(connection: Connection, node: str) -> dict[str, tuple[int, int]]:
    """The number of removed messages of each patch, and before when, UTC ns."""
    rows = connection.execute(select(removals).where(of_node(removals, node))).mappings()
    found: dict[str, tuple[int, int]] = {}
    for row in intact_rows(connection, removals, rows):
        for name in _removed_names(connection, node, row["place"]):
            messages, before = found.get(name, (0, row["before"]))
            found[name] = messages + row["messages"], max(before, row["before"])
    return found


def _removed_names(connection: Connection, node: str, place: str) -> list[str]:
    """The patch of which something was removed; of sealed frames, all of their page."""
    page = read_page(place)
    if page is None:
        return [place]
    try:
        described = find_layout(connection, node, page[0])
    except UnknownDescriptionError:  # damaged, and reported
        return []
    return [described.patches[number].patch_id for number in described.page_ranges[page[1]]]
