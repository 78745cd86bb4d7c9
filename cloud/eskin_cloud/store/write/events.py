"""Rows of events: what a peak, a gap or a status tells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import orjson

from eskin_cloud.store.schema.tables import nodes

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin.wire.messages import Gap, Peak, Position, Status
    from eskin_cloud.store.write.write_cache import Row, WriteCache

ENERGY: Final = ("stored_lo", "stored_hi", "charge_lo", "charge_hi", "sustained", "shedding")
"""Columns of what a node tells of its energy."""
_NOTHING: Final = dict.fromkeys(
    (
        "channel",
        "verdict",
        "count_lo",
        "count_hi",
        "height_lo",
        "height_hi",
        "prominence_lo",
        "prominence_hi",
        "unit",
        "coverage",
        "detail",
        "data",
    )
)


def event_row(
    node: str, kind: str, position: Position, time: tuple[int, int], **rest: object
) -> Row:
    """An event's row, without its place in the feed."""
    return {
        **_NOTHING,
        "node": node,
        "kind": kind,
        "boot": position.boot,
        "sequence": position.sequence,
        "t_lo": time[0],
        "t_hi": time[1],
        **rest,
    }


def peak_row(node: str, peak: Peak, data: bytes) -> Row:
    """A peak's row."""
    return event_row(
        node,
        "peak",
        peak.position,
        peak.time,
        channel=peak.channel,
        verdict=peak.verdict.name.lower(),
        count_lo=peak.count[0],
        count_hi=peak.count[1],
        height_lo=peak.height[0],
        height_hi=peak.height[1],
        prominence_lo=peak.prominence[0],
        prominence_hi=peak.prominence[1],
        unit=peak.unit,
        coverage=peak.coverage,
        data=data,
    )


def gap_row(node: str, gap: Gap, data: bytes) -> Row:
    """A gap's row."""
    return event_row(node, "gap", gap.position, gap.time, detail=gap.detail, data=data)


def status_row(
    connection: Connection, cache: WriteCache, node: str, status: Status, data: bytes, *, now: int
) -> Row | None:
    """Keep the node's latest status; gives a row when it tells of a new start."""
    row = cache.row(connection, nodes, node)
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
        "places": _places(status),
        "clock_earliest": status.time[0],
        "clock_latest": status.time[1],
        "clock_after": status.gateway_time,
        "clock_before": now,
    } | _energy(status)
    if status.held is not None:
        row["held_boot"], row["held_sequence"] = status.held
    cache.change(nodes, node)
    if known[0] is not None and known[0] >= place.boot:
        return None
    cause = "" if status.cause is None else f", {status.cause.label}"
    detail = f"started: boot {place.boot}, {status.profile}{cause}"
    return event_row(node, "status", place, status.time, detail=detail, data=data)


def _faults(status: Status) -> str | None:
    """Which taxels may be broken; nothing before the node's first self-test."""
    if status.faults is None:
        return None
    faults = [
        {"taxel": each.taxel, "dead": each.dead.name.lower(), "stuck": each.stuck.name.lower()}
        for each in status.faults
    ]
    return orjson.dumps(faults).decode()


def _places(status: Status) -> str | None:
    """Where its taxels sit; nothing where none sits somewhere."""
    places = [[place.taxel, place.x, place.y] for place in status.places]
    return orjson.dumps(places).decode() if places else None


def _energy(status: Status) -> Row:
    """What the node tells of its energy; nothing where its supply never ends."""
    energy = status.energy
    if energy is None:
        return dict.fromkeys(ENERGY)
    told = (*energy.stored, *energy.charge, int(energy.verdict), int(energy.shedding))
    return dict(zip(ENERGY, told, strict=True))
