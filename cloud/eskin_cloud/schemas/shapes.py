"""How rows look in JSON. Unbounded sides and missing values are ``null``."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import orjson

from eskin.privacy import is_biometric
from eskin.union_bound import union_coverage
from eskin.wire.messages import Shedding, Sustained
from eskin.wire.timestamp import SECOND, format_timestamp
from eskin_cloud.access import token_id
from eskin_cloud.commands.desired_state import is_settled
from eskin_cloud.query.clock_check import ClockCheck

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import RowMapping

    from eskin.wire.messages import Block
    from eskin_cloud.query.occupancy import Occupancy
    from eskin_cloud.query.opaque_ids import OpaqueIds
    from eskin_cloud.query.segments import Segment
    from eskin_cloud.query.series import Series
    from eskin_cloud.settings import NodesSection
    from eskin_cloud.store.read.window import Window
    from eskin_cloud.store.write.missing_messages import MissingSpan

MOST_RANGES: Final = 16
"""Of what is missing of a node, in an answer."""
Json: TypeAlias = dict[str, Any]
MINUTE: Final = 60 * SECOND
"""ns."""
Row: TypeAlias = "RowMapping | dict[str, Any]"


def dump(value: object) -> bytes:
    """Write JSON; floats as their shortest exact text, infinite ones as ``null``."""
    return orjson.dumps(value, option=orjson.OPT_SERIALIZE_NUMPY)


def page(items: Sequence[Json], following: str | None) -> Json:
    """A page of a list."""
    return {"items": items, "next": following}


def series_shape(series: Series) -> Json:
    """A series."""
    return {
        "node": series.node,
        "channel": series.channel,
        "unit": series.unit,
        "coverage": series.coverage,
        "resolution": series.resolution,
        "t0": format_timestamp(series.t0),
        "t": series.t,
        "lo": series.lo,
        "hi": series.hi,
        "mean": None if series.mean is None else {"lo": series.mean[0], "hi": series.mean[1]},
        "dt": series.dt,
        "time_error": series.time_error,
    }


def block_shape(node: str, block: Block) -> Json:
    """A block, sample by sample; sample k was taken in ``time`` moved by ``k·dt`` ns."""
    tube = block.tube
    return {
        "node": node,
        "channel": block.channel,
        "kind": "block",
        "time": _stretch(*tube.time),
        "dt": tube.dt,
        "unit": tube.unit,
        "coverage": tube.coverage,
        "lo": tube.values.inf,
        "hi": tube.values.sup,
        "boot": block.position.boot,
        "sequence": block.position.sequence,
    }


def event_shape(row: Row, ids: OpaqueIds) -> Json:
    """An event; without its sequence number, which would count what is sealed."""
    return {
        "id": ids.write(row["cursor"]),
        "node": row["node"],
        "channel": row["channel"],
        "kind": row["kind"],
        "verdict": row["verdict"],
        "time": {"lo": format_timestamp(row["t_lo"]), "hi": format_timestamp(row["t_hi"])},
        "height": _interval(row["height_lo"], row["height_hi"]),
        "prominence": _interval(row["prominence_lo"], row["prominence_hi"]),
        "count": _interval(row["count_lo"], row["count_hi"]),
        "unit": row["unit"],
        "coverage": row["coverage"],
        "boot": row["boot"],
        "detail": row["detail"],
    }


def segment_shape(segment: Segment, channel: Row) -> Json:
    """A segment of a threshold's answer.

    Its coverage is the union bound over its samples, at the least coverage that any block of the
    channel claims.
    """
    verdict = segment.answer.name.lower()
    return {
        "id": f"{segment.start}-{segment.end}-{verdict}",
        "start": format_timestamp(segment.start),
        "end": format_timestamp(segment.end),
        "verdict": verdict,
        "coverage": union_coverage(channel["coverage"], n=segment.n),
        "time_error": segment.error,
    }


def occupancy_shape(found: Occupancy, window: Window, channel: Row) -> Json:
    """For how long and how often a channel is in a state; seconds are rounded outward."""
    least, most = found.time
    return {
        "start": format_timestamp(window.start),
        "end": format_timestamp(window.end),
        "unit": channel["unit"],
        "time_s": {"lo": seconds(least, -math.inf), "hi": seconds(most, math.inf)},
        "unknown_s": seconds(found.unknown, math.inf),
        "samples": {"lo": found.samples[0], "hi": found.samples[1]},
        "entries": {"lo": found.entries[0], "hi": found.entries[1]},
        "coverage": union_coverage(channel["coverage"], n=found.n),
        "time_error": found.error,
    }


def seconds(nanoseconds: int, side: float) -> float:
    """As a float on its side of the exact value."""
    exact = Fraction(nanoseconds, 10**9)
    nearest = float(exact)
    wrong = Fraction(nearest) > exact if side < 0 else Fraction(nearest) < exact
    return math.nextafter(nearest, side) if wrong else nearest


def channel_shape(row: Row, removed: tuple[int, int] | None, *, counted: bool = True) -> Json:
    """A channel; ``removed`` is how many messages went, and before when.

    Unless ``counted``, counts and times of a biometric channel are null, and bytes of all: a
    message is longer if its sequence number is.
    """
    taxel, _, quantity = row["channel"].partition(".")
    biometric = is_biometric(row["channel"])
    hidden = biometric and not counted
    return {
        "id": row["channel"],
        "taxel": taxel,
        "quantity": quantity,
        "unit": row["unit"],
        "coverage": row["coverage"],
        "dt": row["dt"],
        "blocks": None if hidden else row["blocks"],
        "samples": None if hidden else row["samples"],
        "bytes": None if biometric or not counted else row["bytes"],
        "first": None if hidden else _moment(row["t_first"]),
        "last": None if hidden else _moment(row["t_last"]),
        "bounds": _interval(row["lo"], row["hi"]),
        "biometric": biometric,
        "removed": None
        if removed is None or hidden
        else {"messages": removed[0], "before": format_timestamp(removed[1])},
    }


def whole_minute(moment: int) -> int:
    """A time as what is sealed may be known by: its minute (docs/privacy.md)."""
    return moment - moment % MINUTE


def node_shape(
    row: Row,
    *,
    channels: int,
    health: str,
    clock_error_s: float,
    holes: Sequence[MissingSpan] = (),
    counted: bool = True,
) -> Json:
    """A node; unless ``counted``, without what would tell when its sealed messages come."""
    outbox = {
        "messages": row["messages"],
        "bytes": row["used"],
        "capacity_bytes": row["capacity"],
    }
    return {
        "id": row["node"],
        "health": health,
        "last_seen": format_timestamp(
            row["last_seen"] if counted else whole_minute(row["last_seen"])
        ),
        "boot": row["boot"],
        "sequence": row["sequence"] if counted else None,
        "profile": row["profile"],
        "description": row["description"],
        "uptime_ns": row["uptime"],
        "outbox": None if row["messages"] is None or not counted else outbox,
        "gaps": row["gaps"] or 0,
        "energy": None if row["shedding"] is None else _energy_shape(row),
        "faults": None if row["faults"] is None else json.loads(row["faults"]),
        "channels": channels,
        "lag": lag_shape(row) if counted else None,
        "clock": clock_shape(row, clock_error_s),
        "missing": missing_shape(holes),
    }


def missing_shape(holes: Sequence[MissingSpan]) -> Json | None:
    """What is missing of a node, as events name it."""
    named = [hole for hole in holes if hole.named]
    if not named:
        return None
    ranges = [{"boot": h.boot, "first": h.first, "last": h.last} for h in named[-MOST_RANGES:]]
    return {
        "messages": sum(hole.messages for hole in named),
        "since": format_timestamp(min(hole.since for hole in named)),
        "ranges": ranges,
    }


def clock_shape(row: Row, error_s: float) -> Json | None:
    """Whether the node's clock holds its bound, by its latest status."""
    if row["clock_before"] is None:
        return None
    check = ClockCheck(
        stated=(row["clock_earliest"], row["clock_latest"]),
        after=row["clock_after"],
        before=row["clock_before"],
        error=round(error_s * SECOND),
    )
    least, most = check.offset
    return {
        "verdict": check.verdict,
        "offset": {"lo_ns": least, "hi_ns": most},
        "references_agree": check.references_agree,
    }


def lag_shape(row: Row) -> Json | None:
    """How long after its last sample the latest block was stored."""
    return None if row["lag_lo"] is None else {"lo_ns": row["lag_lo"], "hi_ns": row["lag_hi"]}


def health_shape(judged: NodesSection, silence: float, *, ahead: float = 0.0) -> str:
    """The verdict on who has been silent for so many seconds.

    Whoever was heard so many seconds ahead was heard before the clock was set back: that says
    nothing of now.
    """
    if silence >= judged.silence_s or ahead >= judged.silence_s:
        return "offline"
    return "online" if silence < judged.late_s else "late"


def taxel_shapes(row: Row) -> list[Json]:
    """A node's taxels, by name."""
    places = orjson.loads(row["places"] or "[]")
    return [{"id": taxel, "position_m": [x, y]} for taxel, x, y in sorted(places)]


def _energy_shape(row: Row) -> Json:
    return {
        "stored": _interval(row["stored_lo"], row["stored_hi"]),
        "charge": _interval(row["charge_lo"], row["charge_hi"]),
        "self_sustaining": Sustained(row["sustained"]).name.lower(),
        "shedding": Shedding(row["shedding"]).name.lower(),
    }


def command_shape(row: Row, *, now: int) -> Json:
    """A command, and what became of it by now."""
    state, reason = row["outcome"], row["reason"]
    if state is None and now >= row["expires"]:
        state, reason = "expired", "no answer came in time"
    elif state is None:
        state = "pending" if row["delivered"] is None else "delivered"
    return {
        "id": row["id"],
        "node": row["node"],
        "name": row["name"],
        "arguments": orjson.loads(row["arguments"]),
        "state": state,
        "reason": reason,
        "issued": format_timestamp(row["issued"]),
        "expires": format_timestamp(row["expires"]),
        "delivered": _moment(row["delivered"]),
        "answered": _stretch(row["t_lo"], row["t_hi"]),
    }


def token_shape(row: Row, *, now: int) -> Json:
    """A token, without its secret."""
    state = "good" if row["expires"] is None or now < row["expires"] else "expired"
    return {
        "id": token_id(row["digest"]),
        "name": row["name"],
        "scopes": row["scopes"].split(),
        "state": state if row["revoked"] is None else "revoked",
        "created": format_timestamp(row["created"]),
        "expires": _moment(row["expires"]),
        "revoked": _moment(row["revoked"]),
    }


def session_shape(row: Row) -> Json:
    """A session, without its secret."""
    return {
        "id": row["id"],
        "name": row["name"],
        "scopes": row["scopes"].split(),
        "expires": format_timestamp(row["expires"]),
    }


def audit_entry_shape(row: Row) -> Json:
    """What somebody did."""
    said = {name: row[name] for name in ("actor", "address", "action", "target", "detail")}
    return (
        {"id": row["number"], "time": format_timestamp(row["time"])}
        | said
        | {"digest": row["digest"]}
    )


def state_shape(node: str, row: Row | None) -> Json:
    """How a node should be set, and how it is; without a row nobody said either."""
    known: Row = row if row is not None else defaultdict(lambda: None)
    desired = orjson.loads(known["desired"] or "{}")
    reported = None if known["reported"] is None else orjson.loads(known["reported"])
    return {
        "node": node,
        "desired": desired,
        "desired_at": _moment(known["desired_at"]),
        "desired_by": known["desired_by"],
        "reported": reported,
        "reported_at": _stretch(known["t_lo"], known["t_hi"]),
        "reported_by": known["reported_by"],
        "settled": is_settled(desired, reported),
    }


def _stretch(lo: int | None, hi: int | None) -> Json | None:
    return (
        None
        if lo is None or hi is None
        else {"lo": format_timestamp(lo), "hi": format_timestamp(hi)}
    )


def _interval(lo: float | None, hi: float | None) -> Json | None:
    return None if lo is None and hi is None else {"lo": lo, "hi": hi}


def _moment(nanoseconds: int | None) -> str | None:
    return None if nanoseconds is None else format_timestamp(nanoseconds)
