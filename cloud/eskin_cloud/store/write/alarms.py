"""Alarms and their transitions: each is stored once, in the transaction that decides it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import orjson
from sqlalchemy import delete, func, insert, select, update

from eskin.wire.timestamp import format_timestamp
from eskin_cloud.store.notify import News, announce
from eskin_cloud.store.row_digests import intact_rows, require_intact_row
from eskin_cloud.store.schema.alarm_tables import (
    alarm_receivers,
    alarm_state,
    alarm_transitions,
    alarms,
)
from eskin_cloud.store.schema.node_key import of_nodes
from eskin_cloud.store.schema.tables import node_sites
from eskin_cloud.store.write.monitors import find_monitor, list_monitors

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sqlalchemy import Connection, RowMapping

RAISED: Final = "raised"
ACKNOWLEDGED: Final = "acknowledged"
ESCALATED: Final = "escalated"
UNSILENCED: Final = "unsilenced"
CLEARED: Final = "cleared"
DEFINED: Final = "defined"
DELETED: Final = "deleted"
_REMOVED_AT_ONCE: Final = 500
LEASE_NS: Final = 10_000_000_000
"""How long a cloud evaluates alone without renewing its lease."""


class AlarmChange(NamedTuple):
    """An episode of a monitor that begins or ends.

    Attributes:
        monitor: Its name.
        revision: Of its definition.
        tick: When, in ticks of the samples' time.
        verdict: With which an episode begins; ``None`` where the open one ends.
        nodes: Nodes that the formula reads.
        ended: When an episode ended that is found afterwards, in late samples.
    """

    monitor: str
    revision: int
    tick: int
    verdict: str | None
    nodes: tuple[str, ...] = ()
    ended: int | None = None


def take_lease(connection: Connection, holder: str, *, now: int, alone: bool) -> bool:
    """Take or renew the lease to evaluate monitors; returns whether the cloud has it.

    Args:
        connection: The writer's, in a transaction.
        holder: Names the cloud's process.
        now: UTC ns.
        alone: Whether no other cloud can use the store.
    """
    found = connection.execute(select(alarm_state.c.holder, alarm_state.c.until)).one()
    if not alone and found.holder not in {None, holder} and now < found.until <= now + LEASE_NS:
        return False
    connection.execute(update(alarm_state).values(holder=holder, until=now + LEASE_NS))
    return True


def apply_changes(
    connection: Connection, changes: Iterable[AlarmChange], *, holder: str, now: int
) -> bool:
    """Raise and clear alarms; returns whether this cloud has the lease, else nothing is done.

    A change of a definition that is no longer current, or of an episode that is known, is dropped.

    Args:
        connection: The writer's, in a transaction.
        changes: Those of a monitor in order of time.
        holder: Names the cloud's process.
        now: UTC ns.
    """
    if connection.execute(select(alarm_state.c.holder)).scalar_one() != holder:
        return False
    for change in changes:
        monitor = find_monitor(connection, change.monitor)
        if monitor is None or monitor["revision"] != change.revision:
            continue
        if change.verdict is not None:
            _raise(connection, monitor, change, now)
            continue
        for alarm in open_alarms(connection, change.monitor):
            if alarm["began"] < change.tick:
                clear_alarm(connection, alarm, now=now, ended=change.tick)
    return True


def _raise(connection: Connection, monitor: RowMapping, change: AlarmChange, now: int) -> None:
    a = alarms.c
    same = (a.monitor == change.monitor) & (a.revision == change.revision)
    if connection.execute(select(a.id).where(same, a.began == change.tick)).first() is not None:
        return
    if change.ended is None and open_alarms(connection, change.monitor):
        return
    number = connection.execute(select(alarm_state.c.last_alarm)).scalar_one() + 1
    connection.execute(update(alarm_state).values(last_alarm=number))
    row: dict[str, Any] = {
        "id": number,
        "monitor": change.monitor,
        "revision": change.revision,
        "formula": monitor["formula"],
        "severity": monitor["severity"],
        "sites": _sites(connection, change.nodes),
        "verdict": change.verdict,
        "began": change.tick,
        "raised": now,
        "notified": 0,
    }
    connection.execute(insert(alarms), row)
    _store(connection, number, RAISED, now, silenced=is_silenced(monitor, now))
    alarm = find_alarm(connection, number)
    if change.ended is not None and alarm is not None:
        clear_alarm(connection, alarm, now=now, ended=change.ended)


def clear_alarm(
    connection: Connection, alarm: RowMapping, *, now: int, ended: int | None = None
) -> None:
    """Clear an alarm.

    Args:
        connection: The writer's, in a transaction.
        alarm: Its row; it is open.
        now: UTC ns.
        ended: When the formula became impossible, in ticks; ``None`` where its monitor was defined
            anew or deleted.
    """
    _change(connection, alarm["id"], cleared=now, ended=ended)
    _store(connection, alarm["id"], CLEARED, now, silenced=not alarm["notified"])


def acknowledge_alarm(
    connection: Connection, number: int, *, actor: str, now: int
) -> RowMapping | None:
    """Acknowledge an alarm, once; returns its row, or ``None`` if there is none."""
    alarm = find_alarm(connection, number)
    if alarm is None or alarm["acknowledged"] is not None:
        return alarm
    _change(connection, number, acknowledged=now, acknowledged_by=actor)
    _store(connection, number, ACKNOWLEDGED, now, silenced=not alarm["notified"])
    return find_alarm(connection, number)


def advance_alarms(connection: Connection, *, holder: str, now: int) -> None:
    """Escalate alarms that are due, and give those whose silence has ended.

    Args:
        connection: The writer's, in a transaction.
        holder: Names the cloud's process; without the lease nothing is done.
        now: UTC ns.
    """
    if connection.execute(select(alarm_state.c.holder)).scalar_one() != holder:
        return
    for number, kind in find_due(connection, now=now):
        if kind == ESCALATED:
            _change(connection, number, escalated=now)
        _store(connection, number, kind, now, silenced=False)


def find_due(connection: Connection, *, now: int) -> list[tuple[int, str]]:
    """Open alarms that are to be escalated, or whose silence has ended."""
    waiting, due = open_alarms(connection), []
    defined = {row["name"]: row for row in list_monitors(connection)} if waiting else {}
    for alarm in waiting:
        monitor = defined.get(alarm["monitor"])
        if monitor is None or is_silenced(monitor, now):
            continue
        if not alarm["notified"]:
            due.append((alarm["id"], UNSILENCED))
        after = monitor["escalate_after"]
        waits = alarm["acknowledged"] is None and alarm["escalated"] is None
        if after is not None and waits and now >= alarm["raised"] + after:
            due.append((alarm["id"], ESCALATED))
    return due


def is_silenced(monitor: RowMapping, now: int) -> bool:
    """Whether a monitor is silenced."""
    return monitor["silenced_until"] is not None and now < monitor["silenced_until"]


def find_alarm(connection: Connection, number: int) -> RowMapping | None:
    """An alarm; ``None`` if there is none.

    Raises:
        DamagedRowError: Its row is damaged.
    """
    row = connection.execute(select(alarms).where(alarms.c.id == number)).mappings().one_or_none()
    return require_intact_row(connection, alarms, row)


def open_alarms(connection: Connection, monitor: str | None = None) -> list[RowMapping]:
    """The alarms that are not cleared, of one monitor or of all, in their order."""
    query = select(alarms).where(alarms.c.cleared.is_(None)).order_by(alarms.c.id)
    if monitor is not None:
        query = query.where(alarms.c.monitor == monitor)
    return intact_rows(connection, alarms, connection.execute(query).mappings())


def count_open_alarms(connection: Connection) -> int:
    """How many alarms are not cleared."""
    query = select(func.count()).select_from(alarms).where(alarms.c.cleared.is_(None))
    return connection.execute(query).scalar_one()


def count_failing_receivers(connection: Connection) -> int:
    """How many receivers did not take what they were last sent."""
    r = alarm_receivers.c
    query = select(func.count()).select_from(alarm_receivers).where(r.failing_since.is_not(None))
    return connection.execute(query).scalar_one()


def find_episodes(
    connection: Connection, monitor: str, revision: int, since: int
) -> list[tuple[int, int | None]]:
    """The episodes of a definition that end after a tick: from and until when, in ticks."""
    a = alarms.c
    query = select(a.began, a.ended).where(a.monitor == monitor, a.revision == revision)
    query = query.where(a.ended.is_(None) | (a.ended > since)).order_by(a.began)
    return [(row.began, row.ended) for row in connection.execute(query)]


def list_alarms(
    connection: Connection,
    *,
    before: int | None = None,
    limit: int,
    monitor: str | None = None,
    is_open: bool | None = None,
) -> list[RowMapping]:
    """Alarms, the latest first.

    Args:
        connection: Any.
        before: Those with lesser ids only.
        limit: How many.
        monitor: Those of one monitor only.
        is_open: Only those that are not cleared, or that are.
    """
    a = alarms.c
    query = select(alarms).order_by(a.id.desc()).limit(limit)
    if before is not None:
        query = query.where(a.id < before)
    if monitor is not None:
        query = query.where(a.monitor == monitor)
    if is_open is not None:
        query = query.where(a.cleared.is_(None) if is_open else a.cleared.is_not(None))
    return intact_rows(connection, alarms, connection.execute(query).mappings())


def list_transitions(connection: Connection, alarm: int) -> list[RowMapping]:
    """The transitions of an alarm, in their order."""
    t = alarm_transitions.c
    query = select(alarm_transitions).where(t.alarm == alarm).order_by(t.number)
    return intact_rows(connection, alarm_transitions, connection.execute(query).mappings())


def remove_cleared(connection: Connection, *, before: int) -> int:
    """Remove alarms that were cleared before a time, once all receivers have been given them.

    Args:
        connection: The writer's, in a transaction.
        before: UTC ns.

    Returns:
        How many.
    """
    a, t = alarms.c, alarm_transitions.c
    r = alarm_receivers.c
    # Gateways are given the latest state, too: none of them is waited for.
    least = select(func.min(r.delivered)).where(r.name.not_like("site %"))
    given = connection.execute(least).scalar_one()
    old = select(a.id).where(a.cleared < before).order_by(a.id).limit(_REMOVED_AT_ONCE)
    if given is not None:
        old = old.where(a.id.not_in(select(t.alarm).where(t.number > given)))
    found = connection.execute(old).scalars().all()
    if found:
        connection.execute(delete(alarm_transitions).where(t.alarm.in_(found)))
        connection.execute(delete(alarms).where(a.id.in_(found)))
    return len(found)


def _change(connection: Connection, number: int, **values: object) -> None:
    connection.execute(update(alarms).where(alarms.c.id == number).values(**values))


def note_definition(
    connection: Connection, monitor: RowMapping, nodes: Iterable[str], kind: str, *, now: int
) -> None:
    """Have gateways learn of a monitor without an alarm.

    Args:
        connection: The writer's, in a transaction.
        monitor: Its row.
        nodes: Nodes that its formula reads.
        kind: `DEFINED` or `DELETED`.
        now: UTC ns.
    """
    _append(connection, monitor["name"], kind, now, sites=_sites(connection, nodes))


def _store(connection: Connection, number: int, kind: str, now: int, *, silenced: bool) -> None:
    """Store a change of an alarm."""
    if not silenced:
        _change(connection, number, notified=1)
    alarm = find_alarm(connection, number)
    assert alarm is not None  # noqa: S101 - the caller has it
    _append(
        *(connection, alarm["monitor"], kind, now),
        sites=alarm["sites"],
        alarm=alarm,
        silenced=silenced,
    )


def _append(
    connection: Connection,
    monitor: str,
    kind: str,
    now: int,
    *,
    sites: str,
    alarm: RowMapping | None = None,
    silenced: bool = True,
) -> None:
    """Append a transition under the next number."""
    number = connection.execute(select(alarm_state.c.last_number)).scalar_one() + 1
    connection.execute(
        update(alarm_state).values(last_number=number, version=alarm_state.c.version + 1)
    )
    described = None if alarm is None else describe_alarm(alarm)
    document = {
        "number": number,
        "transition": kind,
        "time": format_timestamp(now),
        "silenced": silenced,
        "monitor": monitor,
        "state": "cleared" if described is None else described["state"],
        "alarm": described,
    }
    row = {
        "number": number,
        "alarm": None if alarm is None else alarm["id"],
        "monitor": monitor,
        "kind": kind,
        "time": now,
        "silenced": int(silenced),
        "sites": sites,
        "document": orjson.dumps(document).decode(),
    }
    connection.execute(insert(alarm_transitions), row)
    # Gateways that wait for commands wait for alarms, too.
    announce(connection, News(commands=True))


def _sites(connection: Connection, nodes: Iterable[str]) -> str:
    """The sites of nodes, each between blanks."""
    query = select(node_sites.c.site).where(of_nodes(node_sites, list(nodes))).distinct()
    return f" {' '.join(sorted(connection.execute(query).scalars()))} "


def describe_alarm(alarm: RowMapping) -> dict[str, Any]:
    """An alarm as callers and receivers are given it."""

    def instant(name: str, *, ticks: bool = False) -> str | None:
        value = alarm[name]
        if value is None:
            return None
        return format_timestamp(value // 2 if ticks else value)

    return {
        "id": alarm["id"],
        "monitor": alarm["monitor"],
        "revision": alarm["revision"],
        "formula": alarm["formula"],
        "severity": alarm["severity"],
        "verdict": alarm["verdict"],
        "state": "raised" if alarm["cleared"] is None else "cleared",
        "began": instant("began", ticks=True),
        "ended": instant("ended", ticks=True),
        "raised": instant("raised"),
        "acknowledged": instant("acknowledged"),
        "acknowledged_by": alarm["acknowledged_by"],
        "escalated": instant("escalated"),
        "cleared": instant("cleared"),
    }
