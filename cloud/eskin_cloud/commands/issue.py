"""Issue commands: numbered, signed and kept in one transaction, with the desired state.

The desired state of a node holds the settings that all commands since its last reset ask for.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sqlalchemy import func, insert, select

from eskin.errors import CommandError, EskinError
from eskin.wire.messages import Command, CommandName
from eskin.wire.messages.command import (
    MONITOR_SETTINGS,
    NEVER,
    SETTINGS,
    WHOLE_NODE,
    place_of,
)
from eskin.wire.timestamp import SECOND
from eskin_cloud.store.notify import News, announce
from eskin_cloud.store.read.lookup import find_node
from eskin_cloud.store.read.patch_runs import find_layouts
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import commands
from eskin_cloud.store.write.commands import encode_state, find_command, find_state, update_state

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import Connection, RowMapping

    from eskin.wire.messages.command import Arguments, State, Value

MOST_WAITING: Final = 100


def merge_desired_state(desired_state: State, name: CommandName, arguments: Arguments) -> State:
    """The desired state after a command; settings of the whole node replace those of its taxels."""
    if name is CommandName.RESET:
        return {}
    if name is CommandName.MONITOR:
        place = place_of(arguments)
        others = {other: found for other, found in desired_state.items() if other != place}
        own: dict[str, Value] = {
            field: arguments[field] for field in MONITOR_SETTINGS if field in arguments
        }
        return others | {place: own}
    settings = {field: value for field, value in arguments.items() if field in SETTINGS}
    if not settings:
        return desired_state
    place = place_of(arguments)
    merged = {
        other: {
            field: value
            for field, value in found.items()
            if place != WHOLE_NODE or field not in settings
        }
        for other, found in desired_state.items()
    }
    merged[place] = merged.get(place, {}) | settings
    return {where: found for where, found in merged.items() if found}


def is_settled(desired_state: State, reported: State | None) -> bool:
    """Whether the reported state of a node has all settings of its desired state."""
    return all(
        _reports(reported or {}, desired_state, place, field, value)
        for place, settings in desired_state.items()
        for field, value in settings.items()
    )


def _reports(reported: State, desired_state: State, place: str, field: str, value: Value) -> bool:
    if field in reported.get(place, {}):
        return reported[place][field] == value
    if field == "on" and value == NEVER:
        return True  # of a monitor that it does not have
    if place != WHOLE_NODE:
        return False
    taxels = {taxel: found[field] for taxel, found in reported.items() if field in found}
    # A setting of a taxel overrides that of the whole node.
    return bool(taxels) and all(
        found == value
        for taxel, found in taxels.items()
        if field not in desired_state.get(taxel, {})
    )


class BacklogError(EskinError):
    """Too many commands wait for a node's answer already."""


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
