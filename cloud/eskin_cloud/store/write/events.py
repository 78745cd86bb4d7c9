"""Rows of events: of statuses, and one for each peak, contact, verdict and gap of statements.

The latest verdict that a node stated of each of its monitors has a row of its own.
"""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING, Final

import orjson
from sqlalchemy import delete, insert, select, tuple_, update

from eskin.wire.frames import Because
from eskin.wire.slot import key_of
from eskin_cloud.store.feed_entry import FeedEntry
from eskin_cloud.store.row_digests import empty_row, intact_rows
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import events, node_verdicts, nodes

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from sqlalchemy import Connection, RowMapping

    from eskin.wire.frames import Contact, DescribedLayout, Gap, MonitorVerdict, Peak, Statements
    from eskin.wire.messages import Position, Status
    from eskin_cloud.store.write.write_cache import Row, WriteCache

_ENERGY: Final = ("stored_lo", "stored_hi", "charge_lo", "charge_hi", "sustained", "shedding")
"""Columns of a node's energy."""
_EMPTY: Final = empty_row(events)
_STATED: Final = ("boot", "sequence", "verdict", "t_lo", "t_hi", "coverage", "detail")


def event_row(
    node: str, kind: str, position: Position, time: tuple[int, int], **rest: object
) -> Row:
    """An event's row, without its cursor."""
    return {
        **_EMPTY,
        "node": node,
        "kind": kind,
        "boot": position.boot,
        "sequence": position.sequence,
        "t_lo": time[0],
        "t_hi": time[1],
        **rest,
    }


def store_event(connection: Connection, cache: WriteCache, row: Row, *, now: int) -> FeedEntry:
    """Store an event's row; returns its entry for the live feed."""
    cursor = cache.next_cursor(row["node"])
    row |= {"cursor": cursor, "received": now}
    connection.execute(insert(events), row)
    return FeedEntry(cursor, row["node"], row["channel"], row, now)


def status_row(
    connection: Connection, cache: WriteCache, node: str, status: Status, data: bytes, *, now: int
) -> Row | None:
    """Store the node's latest status; returns an event's row for a new boot."""
    row = cache.row(connection, nodes, *key_of(node))
    if row is None:
        return None
    place = status.position
    known = row["status_boot"], row["status_sequence"]
    if known[0] is not None and known > (place.boot, place.sequence):
        return None
    row |= {
        "status_boot": place.boot,
        "status_sequence": place.sequence,
        "profile": status.profile,
        "description": status.description,
        "uptime": status.uptime,
        "messages": status.messages,
        "used": status.used,
        "capacity": status.capacity,
        "gaps": status.gaps,
        "faults": _faults(status),
        "clock_earliest": status.time[0],
        "clock_latest": status.time[1],
        "clock_after": status.gateway_time,
        "clock_before": now,
    } | _energy(status)
    if status.held is not None:
        row["held_boot"], row["held_sequence"] = status.held
    cache.change(nodes, *key_of(node))
    if known[0] is not None and known[0] >= place.boot:
        return None
    cause = "" if status.cause is None else f", {status.cause.label}"
    detail = f"started: boot {place.boot}, {status.profile}{cause}"
    return event_row(node, "status", place, status.time, detail=detail, data=data)


def _faults(status: Status) -> str | None:
    """Possibly broken taxels as JSON; ``None`` before the first self-test."""
    if status.faults is None:
        return None
    faults = [
        {"taxel": each.taxel, "dead": each.dead.name.lower(), "stuck": each.stuck.name.lower()}
        for each in status.faults
    ]
    return orjson.dumps(faults).decode()


def _energy(status: Status) -> Row:
    """The node's energy; ``None`` values for a node with mains supply."""
    energy = status.energy
    if energy is None:
        return dict.fromkeys(_ENERGY)
    values = (*energy.stored, *energy.charge, int(energy.verdict), int(energy.shedding))
    return dict(zip(_ENERGY, values, strict=True))


def statement_rows(
    node: str, statements: Statements, described: DescribedLayout, data: bytes
) -> Iterator[Row]:
    """The rows, without cursors; the first holds the message.

    Args:
        node: The node.
        statements: What it stated.
        described: The layout by which it is read.
        data: The message's bytes.
    """
    rows = chain(
        (_peak_row(node, statements, each, described) for each in statements.peaks),
        (_contact_row(node, statements, each) for each in statements.contacts),
        (_verdict_row(node, statements, each) for each in statements.verdicts),
        (_gap_row(node, statements, each, described) for each in statements.gaps),
    )
    for number, row in enumerate(rows):
        yield row if number else row | {"data": data}


def _peak_row(node: str, statements: Statements, peak: Peak, described: DescribedLayout) -> Row:
    patch = described.patches[peak.patch]
    return event_row(
        node,
        "peak",
        statements.position,
        peak.time,
        channel=patch.channels[peak.column],
        verdict=peak.verdict.name.lower(),
        count_lo=peak.counts[0],
        count_hi=peak.counts[1],
        height_lo=peak.height[0],
        height_hi=peak.height[1],
        prominence_lo=peak.prominence[0],
        prominence_hi=peak.prominence[1],
        unit=patch.unit,
        coverage=peak.coverage,
    )


def _contact_row(node: str, statements: Statements, contact: Contact) -> Row:
    links = [{"contact": each.contact, "verdict": each.verdict.name.lower()}
             for each in contact.links]  # fmt: skip
    detail = {
        "label": contact.label,
        "cells": contact.cells,
        "force": contact.force,
        "centroid": contact.centroid,
        "links": links,
    }
    return event_row(
        node,
        "contact",
        statements.position,
        contact.time,
        verdict=contact.verdict.name.lower(),
        count_lo=contact.counts[0],
        count_hi=contact.counts[1],
        coverage=contact.coverage,
        detail=orjson.dumps(detail).decode(),
    )


def _verdict_row(node: str, statements: Statements, verdict: MonitorVerdict) -> Row:
    because = [each.name.lower() for each in Because if each in verdict.because and each.name]
    detail = {"monitor": verdict.monitor, "final": verdict.final, "because": because}
    return event_row(
        node,
        "verdict",
        statements.position,
        verdict.time,
        verdict=verdict.verdict.name.lower(),
        coverage=verdict.coverage,
        detail=orjson.dumps(detail).decode(),
    )


def _gap_row(node: str, statements: Statements, gap: Gap, described: DescribedLayout) -> Row:
    counts = ((gap.messages, "message"), (gap.samples, "sample"))
    lost = [f"{count} {what}{'s' * (count != 1)}" for count, what in counts if count]
    detail = f"{gap.reason}: {' and '.join(lost)} lost" if lost else gap.reason
    if gap.patches:
        names = ", ".join(described.patches[patch].patch_id for patch in gap.patches)
        detail += f"; patches {names}"
    return event_row(node, "gap", statements.position, gap.time, detail=detail)


def store_verdicts(connection: Connection, stated: Iterable[Row]) -> None:
    """Keep the last verdict of each monitor that a message states, unless a later one is known.

    Args:
        connection: The writer's, in a transaction.
        stated: Rows of the message's events, in the order in which it states them.
    """
    v = node_verdicts.c
    latest = {orjson.loads(row["detail"])["monitor"]: row for row in stated}
    for monitor, row in latest.items():
        here = of_node(node_verdicts, row["node"]) & (v.monitor == monitor)
        values = {name: row[name] for name in _STATED}
        known = connection.execute(select(v.boot, v.sequence).where(here)).one_or_none()
        if known is None:
            values |= {"node": row["node"], "monitor": monitor}
            connection.execute(insert(node_verdicts), values)
        elif tuple(known) < (row["boot"], row["sequence"]):
            connection.execute(update(node_verdicts).where(here).values(values))


def find_verdicts(connection: Connection, node: str) -> dict[str, RowMapping]:
    """A node's latest verdicts, by monitor; damaged rows are left out."""
    query = select(node_verdicts).where(of_node(node_verdicts, node))
    rows = intact_rows(connection, node_verdicts, connection.execute(query).mappings())
    return {row["monitor"]: row for row in rows}


def forget_verdicts(
    connection: Connection, node: str, names: Collection[str], before: tuple[int, int]
) -> None:
    """Forget what a node stated of some monitors before a message: they were defined anew."""
    if names:
        v = node_verdicts.c
        earlier = tuple_(v.boot, v.sequence) < tuple_(*before)
        connection.execute(
            delete(node_verdicts).where(of_node(node_verdicts, node), v.monitor.in_(names), earlier)
        )
