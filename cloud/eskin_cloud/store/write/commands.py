"""Rows of commands, their results, and nodes' desired and reported states."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from sqlalchemy import insert, select, update

from eskin.wire.messages.command import MONITOR_PLACE
from eskin_cloud.store.notify import News, announce
from eskin_cloud.store.row_digests import require_intact_row
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import commands, states
from eskin_cloud.store.write.events import event_row, forget_verdicts

if TYPE_CHECKING:
    from sqlalchemy import Connection, RowMapping

    from eskin.wire.messages import Result
    from eskin.wire.messages.command import State
    from eskin_cloud.store.write.write_cache import Row


def find_command(connection: Connection, node: str, number: int) -> RowMapping | None:
    """A command's row."""
    query = select(commands).where(of_node(commands, node), commands.c.id == number)
    row = connection.execute(query).mappings().one_or_none()
    return require_intact_row(connection, commands, row)


def find_state(connection: Connection, node: str) -> RowMapping | None:
    """A node's desired and reported state; ``None`` if there is none."""
    query = select(states).where(of_node(states, node))
    row = connection.execute(query).mappings().one_or_none()
    return require_intact_row(connection, states, row)


def update_state(connection: Connection, node: str, **values: Any) -> None:
    """Change some columns of a node's state."""
    changed = connection.execute(update(states).where(of_node(states, node)).values(values))
    if changed.rowcount == 0:
        connection.execute(insert(states), {"node": node} | values)


def store_result(connection: Connection, node: str, result: Result, data: bytes) -> Row | None:
    """Store a result; returns an event's row for a command's first result."""
    known = find_state(connection, node)
    place = result.position.boot, result.position.sequence
    before = None if known is None else (known["boot"], known["sequence"])
    if before is None or before[0] is None or before < place:
        update_state(
            connection,
            node,
            reported=encode_state(result.state),
            boot=place[0],
            sequence=place[1],
            t_lo=result.time[0],
            t_hi=result.time[1],
            reported_by=result.command or None,
        )
        earlier = json.loads((known and known["reported"]) or "{}")
        forget_verdicts(connection, node, _redefined(earlier, result.state), place)
    command = find_command(connection, node, result.command)
    if command is None or command["outcome"] is not None:
        return None
    outcome = result.outcome.name.lower()
    here = of_node(commands, node) & (commands.c.id == result.command)
    connection.execute(
        update(commands)
        .where(here)
        .values(outcome=outcome, reason=result.reason, t_lo=result.time[0], t_hi=result.time[1])
    )
    announce(connection, News(commands=True))
    result_text = outcome if result.reason is None else f"{outcome}: {result.reason}"
    detail = f"{command['name']} {_format_arguments(json.loads(command['arguments']))}".rstrip()
    return event_row(
        node, "command", result.position, result.time, detail=f"{detail}: {result_text}", data=data
    )


def encode_state(state: State) -> str:
    """A state as JSON."""
    return json.dumps(state, sort_keys=True)


def _redefined(earlier: State, state: State) -> list[str]:
    """The monitors that are others than before."""
    return [
        place.removeprefix(MONITOR_PLACE)
        for place in earlier.keys() | state.keys()
        if place.startswith(MONITOR_PLACE) and earlier.get(place) != state.get(place)
    ]


def _format_arguments(arguments: dict[str, Any]) -> str:
    return " ".join(
        f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in arguments.items()
    )
