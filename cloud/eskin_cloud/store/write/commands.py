"""Keeping commands, what became of them, and how nodes are and should be set."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from sqlalchemy import insert, select, update

from eskin_cloud.store.notify import COMMANDS, notify
from eskin_cloud.store.row_digests import require_sound_row
from eskin_cloud.store.schema.tables import commands, states
from eskin_cloud.store.write.events import event_row

if TYPE_CHECKING:
    from sqlalchemy import Connection, RowMapping

    from eskin.wire.messages import Result
    from eskin.wire.messages.command_schema import State
    from eskin_cloud.store.write.write_cache import Row


def find_command(connection: Connection, node: str, number: int) -> RowMapping | None:
    """A command's row."""
    query = select(commands).where(commands.c.node == node, commands.c.id == number)
    row = connection.execute(query).mappings().one_or_none()
    return require_sound_row(connection, commands, row)


def find_state(connection: Connection, node: str) -> RowMapping | None:
    """How a node is and should be set; ``None`` if neither was ever said."""
    query = select(states).where(states.c.node == node)
    row = connection.execute(query).mappings().one_or_none()
    return require_sound_row(connection, states, row)


def keep_state(connection: Connection, node: str, **values: Any) -> None:
    """Change some columns of a node's state."""
    changed = connection.execute(update(states).where(states.c.node == node).values(values))
    if changed.rowcount == 0:
        connection.execute(insert(states), {"node": node} | values)


def keep_result(connection: Connection, node: str, result: Result, data: bytes) -> Row | None:
    """Keep a result; gives an event's row where a command is answered for the first time."""
    known = find_state(connection, node)
    place = result.position.boot, result.position.sequence
    before = None if known is None else (known["boot"], known["sequence"])
    if before is None or before[0] is None or before < place:
        keep_state(
            connection,
            node,
            reported=write_state(result.state),
            boot=place[0],
            sequence=place[1],
            t_lo=result.time[0],
            t_hi=result.time[1],
            reported_by=result.command or None,
        )
    command = find_command(connection, node, result.command)
    if command is None or command["outcome"] is not None:
        return None
    outcome = result.outcome.name.lower()
    here = (commands.c.node == node) & (commands.c.id == result.command)
    connection.execute(
        update(commands)
        .where(here)
        .values(outcome=outcome, reason=result.reason, t_lo=result.time[0], t_hi=result.time[1])
    )
    notify(connection, COMMANDS)
    said = outcome if result.reason is None else f"{outcome}: {result.reason}"
    detail = f"{command['name']} {_written(json.loads(command['arguments']))}".rstrip()
    return event_row(
        node, "command", result.position, result.time, detail=f"{detail}: {said}", data=data
    )


def write_state(state: State) -> str:
    """A state as the store keeps it."""
    return json.dumps(state, sort_keys=True)


def _written(arguments: dict[str, Any]) -> str:
    return " ".join(
        f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in arguments.items()
    )
