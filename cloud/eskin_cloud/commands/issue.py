"""Issuing commands: numbered, signed and kept in one transaction."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sqlalchemy import func, insert, select

from eskin.errors import CommandError, EskinError
from eskin.wire.messages import Command, CommandName
from eskin.wire.timestamp import SECOND
from eskin_cloud.commands.desired_state import merge_desired_state
from eskin_cloud.store.notify import News, announce
from eskin_cloud.store.read.lookup import find_node
from eskin_cloud.store.read.patch_runs import find_layouts
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import commands
from eskin_cloud.store.write.commands import encode_state, find_command, find_state, update_state

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import Connection, RowMapping

    from eskin.wire.messages.command import Arguments


class BacklogError(EskinError):
    """Too many commands wait for a node's answer already."""


MOST_WAITING: Final = 100


@dataclass(frozen=True, slots=True)
class Order:
    """A command for a node.

    Attributes:
        node: The node.
        name: The command's name.
        arguments: As `eskin.wire.messages.command.check_arguments` allows.
        lifetime: How long the node may carry it out, ns.
    """

    node: str
    name: CommandName
    arguments: Arguments
    lifetime: int


def issue(
    connection: Connection, order: Order, *, sign: Callable[[Command], bytes], now: int
) -> RowMapping:
    """Store a command and the new desired state of its node.

    Args:
        connection: The writing thread's, in a transaction.
        order: The command.
        sign: Signs a command for its node.
        now: UTC ns.

    Returns:
        The command's row.

    Raises:
        UnknownPlaceError: The node has sent no message yet.
        CommandError: The node has no such taxel or channel.
        BacklogError: Too many commands wait for the node's answer.
    """
    node = order.node
    find_node(connection, node)
    _require_place(connection, order)
    _require_room(connection, node, now)
    number = _next_id(connection, node, now)
    command = Command(number, node, now, now + order.lifetime, order.name, order.arguments)
    row = {
        "node": node,
        "id": number,
        "name": str(order.name),
        "arguments": json.dumps(order.arguments),
        "issued": now,
        "expires": command.expires,
        "data": sign(command),
    }
    connection.execute(insert(commands), row)
    announce(connection, News(commands=True))
    known = find_state(connection, node)
    desired_state = json.loads(known["desired"]) if known is not None and known["desired"] else {}
    desired_state = merge_desired_state(desired_state, order.name, order.arguments)
    update_state(
        connection, node, desired=encode_state(desired_state), desired_at=now, desired_by=number
    )
    kept = find_command(connection, node, number)
    assert kept is not None  # noqa: S101 - inserted above
    return kept


def _next_id(connection: Connection, node: str, now: int) -> int:
    """Above all before; also above those of a store that was lost: a node remembers its last."""
    last = connection.execute(
        select(func.max(commands.c.id)).where(of_node(commands, node))
    ).scalar_one()
    return max((last or 0) + 1, now // SECOND)


def _require_room(connection: Connection, node: str, now: int) -> None:
    c = commands.c
    waiting = select(func.count()).where(
        of_node(commands, node), c.outcome.is_(None), c.expires > now
    )
    count = connection.execute(waiting).scalar_one()
    if count >= MOST_WAITING:
        raise BacklogError(
            f"{count} commands wait for {node} already; wait until it answers, or they expire"
        )


def _require_place(connection: Connection, order: Order) -> None:
    layouts = find_layouts(connection, order.node)
    known = sorted({channel for described in layouts for channel in described.places})
    places = {"channel": known, "taxel": sorted({name.partition(".")[0] for name in known})}
    for field, listed in places.items():
        asked = order.arguments.get(field)
        if asked is not None and known and asked not in listed:
            shown = ", ".join(listed[:20]) + (", …" if len(listed) > 20 else "")
            raise CommandError(field, asked, f"what {order.node} has: {shown}")
