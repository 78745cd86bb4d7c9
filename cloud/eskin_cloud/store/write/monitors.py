"""Monitors as callers define them: rows of `schema.alarm_tables.monitors`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Final

from sqlalchemy import delete, func, insert, select, update

from eskin.errors import QueryError
from eskin_cloud.store.row_digests import intact_rows, require_intact_row
from eskin_cloud.store.schema.alarm_tables import alarm_state, monitors

if TYPE_CHECKING:
    from sqlalchemy import Connection, RowMapping

MOST_MONITORS: Final = 20_000
"""Of one cloud: each costs memory and work."""


@dataclass(frozen=True, slots=True)
class MonitorDefinition:
    """What a caller defines.

    Attributes:
        formula: In signal temporal logic, with bounded windows.
        node: Of channels without one; ``None`` where each has one.
        raise_on: The least verdict that raises an alarm: ``possible``, ``certain``, or ``never``.
        missing: Whether samples that do not exist count for *possible*.
        severity: What receivers are given with it.
        clear_after: How long the formula must be impossible until the alarm is cleared, ns.
        escalate_after: After how long an alarm that is not acknowledged is escalated, ns.
    """

    formula: str
    node: str | None
    raise_on: str
    missing: bool
    severity: str
    clear_after: int
    escalate_after: int | None


def find_monitor(connection: Connection, name: str) -> RowMapping | None:
    """A monitor; ``None`` if there is none of the name.

    Raises:
        DamagedRowError: Its row is damaged.
    """
    query = select(monitors).where(monitors.c.name == name)
    row = connection.execute(query).mappings().one_or_none()
    return require_intact_row(connection, monitors, row)


def list_monitors(
    connection: Connection, *, after: str = "", limit: int | None = None
) -> list[RowMapping]:
    """The intact rows of monitors whose names come after one, in their order."""
    query = select(monitors).where(monitors.c.name > after).order_by(monitors.c.name).limit(limit)
    return intact_rows(connection, monitors, connection.execute(query).mappings())


def put_monitor(
    connection: Connection, name: str, definition: MonitorDefinition, *, now: int
) -> tuple[RowMapping | None, RowMapping]:
    """Define a monitor, or define it anew.

    A definition that differs gets a new revision and is evaluated from now on. The same one
    changes nothing.

    Args:
        connection: The writer's, in a transaction.
        name: Its name.
        definition: What it is from now on.
        now: UTC ns.

    Returns:
        The row before, if there was one, and the row now.

    Raises:
        QueryError: There are too many monitors.
        DamagedRowError: Its row is damaged.
    """
    known = find_monitor(connection, name)
    values = asdict(definition) | {"missing": int(definition.missing)}
    if known is not None and all(known[field] == value for field, value in values.items()):
        return known, known
    if known is None:
        count = connection.execute(select(func.count()).select_from(monitors)).scalar_one()
        if count >= MOST_MONITORS:
            raise QueryError(
                "monitor", f"{count} monitors exist, as many as one cloud may have; delete one"
            )
        row = {"name": name, "created": now, "silenced_until": None}
        row |= values | {"changed": now, "revision": 1, "settled": 2 * now}
        connection.execute(insert(monitors), row)
    else:
        values |= {"changed": now, "revision": known["revision"] + 1, "settled": 2 * now}
        connection.execute(update(monitors).where(monitors.c.name == name).values(**values))
    _changed(connection)
    found = find_monitor(connection, name)
    assert found is not None  # noqa: S101 - written above
    return known, found


def delete_monitor(connection: Connection, name: str) -> RowMapping | None:
    """Delete a monitor; returns its row, or ``None`` if there was none."""
    known = find_monitor(connection, name)
    if known is not None:
        connection.execute(delete(monitors).where(monitors.c.name == name))
        _changed(connection)
    return known


def silence_monitor(connection: Connection, name: str, until: int | None) -> bool:
    """Silence a monitor until a time, or no more; returns whether there is one."""
    query = update(monitors).where(monitors.c.name == name).values(silenced_until=until)
    found = connection.execute(query).rowcount > 0
    if found:
        _changed(connection)
    return found


def settle_monitors(connection: Connection, settled: dict[tuple[str, int], int]) -> None:
    """Note up to which tick monitors have been evaluated, by name and revision."""
    m = monitors.c
    for (name, revision), tick in settled.items():
        here = (m.name == name) & (m.revision == revision) & (m.settled < tick)
        connection.execute(update(monitors).where(here).values(settled=tick))


def _changed(connection: Connection) -> None:
    connection.execute(update(alarm_state).values(version=alarm_state.c.version + 1))
