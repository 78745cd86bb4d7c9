"""Rows of events."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import orjson
from sqlalchemy import insert

from eskin.wire.slot import key_of
from eskin_cloud.store.feed_entry import FeedEntry
from eskin_cloud.store.row_digests import empty_row
from eskin_cloud.store.schema.tables import events, nodes

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin.wire.messages import Position, Status
    from eskin_cloud.store.write.write_cache import Row, WriteCache

ENERGY: Final = ("stored_lo", "stored_hi", "charge_lo", "charge_hi", "sustained", "shedding")
"""Columns of a node's energy."""
_EMPTY: Final = empty_row(events)


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
        return dict.fromkeys(ENERGY)
    values = (*energy.stored, *energy.charge, int(energy.verdict), int(energy.shedding))
    return dict(zip(ENERGY, values, strict=True))
