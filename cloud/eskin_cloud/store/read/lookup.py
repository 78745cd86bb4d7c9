"""Find a node or a channel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from sqlalchemy import select

from eskin.errors import QueryError
from eskin_cloud.store.read.patch_columns import describe_columns
from eskin_cloud.store.read.patch_runs import find_layouts
from eskin_cloud.store.row_digests import require_intact_row
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import nodes

if TYPE_CHECKING:
    from sqlalchemy import Connection, RowMapping

Channel: TypeAlias = dict[str, Any]
"""A channel, as `describe_columns` gives it."""


class UnknownChannelError(QueryError):
    """The node or channel is unknown."""


def find_node(connection: Connection, node: str) -> RowMapping:
    """A node's row.

    Raises:
        UnknownChannelError: The node is unknown.
        DamagedRowError: Its row is damaged.
    """
    row = connection.execute(select(nodes).where(of_node(nodes, node))).mappings().one_or_none()
    row = require_intact_row(connection, nodes, row)
    if row is None:
        raise UnknownChannelError("node", f"{node!r} is not known; GET /api/v1/nodes lists all")
    return row


def find_channel(connection: Connection, node: str, channel: str) -> Channel:
    """A channel, by the node's layouts; the latest one that has it counts.

    Raises:
        UnknownChannelError: The node or the channel is unknown.
        UnknownDescriptionError: A layout is damaged in the store.
        DamagedRowError: The node's row, or totals of a page or of the patch, are damaged.
    """
    for described in find_layouts(connection, node):
        place = described.places.get(channel)
        if place is not None:
            return describe_columns(connection, node, described.patches[place[0]])[place[1]]
    find_node(connection, node)
    raise UnknownChannelError(
        "channel",
        f"{channel!r} of {node} is not known; GET /api/v1/nodes/{node}/channels lists all",
    )


def parse_channel(text: str, parameter: str = "channel") -> tuple[str, str]:
    """Parse a parameter ``NODE/CHANNEL``.

    Raises:
        QueryError: The text has another form.
    """
    node, slash, channel = text.partition("/")
    if not slash or not node or not channel:
        raise QueryError(
            parameter, f"{text!r} is no NODE/CHANNEL such as fingertip/t01.capacitance"
        )
    return node, channel
