"""Finding a node's and a channel's row."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import RowMapping, bindparam, select

from eskin.errors import QueryError
from eskin_cloud.store.read.errors import UnknownChannelError
from eskin_cloud.store.row_digests import require_sound_row
from eskin_cloud.store.schema.tables import channels, nodes

if TYPE_CHECKING:
    from sqlalchemy import Connection

_CHANNEL: Final = select(channels).where(
    channels.c.node == bindparam("node"), channels.c.channel == bindparam("channel")
)


def find_node(connection: Connection, node: str) -> RowMapping:
    """A node's row.

    Raises:
        UnknownPlaceError: It never said anything.
        DamagedRowError: Its row is damaged.
    """
    row = connection.execute(select(nodes).where(nodes.c.node == node)).mappings().one_or_none()
    row = require_sound_row(connection, nodes, row)
    if row is None:
        raise UnknownChannelError("node", f"{node!r} is not known; GET /api/v1/nodes lists all")
    return row


def find_channel(connection: Connection, node: str, channel: str) -> RowMapping:
    """A channel's row.

    Raises:
        UnknownPlaceError: The node or the channel never said anything.
        DamagedRowError: Its row is damaged.
    """
    said = {"node": node, "channel": channel}
    row = connection.execute(_CHANNEL, said).mappings().one_or_none()
    row = require_sound_row(connection, channels, row)
    if row is None:
        find_node(connection, node)
        raise UnknownChannelError(
            "channel",
            f"{channel!r} of {node} is not known; GET /api/v1/nodes/{node}/channels lists all",
        )
    return row


def read_place(text: str, parameter: str = "channel") -> tuple[str, str]:
    """Node and channel of a parameter ``NODE/CHANNEL``.

    Raises:
        QueryError: It is none.
    """
    node, slash, channel = text.partition("/")
    if not slash or not node or not channel:
        raise QueryError(
            parameter, f"{text!r} is no NODE/CHANNEL such as fingertip/t01.capacitance"
        )
    return node, channel
