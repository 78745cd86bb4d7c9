"""Nodes and their channels."""

import json
from collections.abc import Sequence
from typing import Final, Literal, cast

from typing_extensions import TypedDict

from eskin.interval import Verdict
from eskin.privacy import is_biometric
from eskin.wire.messages import Shedding
from eskin.wire.timestamp import SECOND, format_timestamp
from eskin_cloud.query.clock_check import ClockCheck
from eskin_cloud.schemas.base import (
    Instant,
    IntervalDocument,
    LagDocument,
    Row,
    instant,
    lag,
    whole_minute,
)
from eskin_cloud.settings import NodesSection
from eskin_cloud.store.write.missing_messages import MissingSpan

_Verdict = Literal["certain", "possible", "impossible"]
_Shedding = Literal["none", "adaptive", "peaks", "sleep"]
Health = Literal["online", "late", "offline"]
_MOST_RANGES: Final = 16
"""Of what is missing of a node, in an answer."""


class OutboxDocument(TypedDict):
    """What waits in a node's flash."""

    messages: int
    bytes: int
    capacity_bytes: int


class EnergyDocument(TypedDict):
    """What a node knows of its energy: stored in J, charge from 0 (brown-out) to 1 (full)."""

    stored: IntervalDocument
    charge: IntervalDocument
    self_sustaining: _Verdict
    shedding: _Shedding


class FaultDocument(TypedDict):
    """A taxel that may be broken, by the latest window of its node's self-test."""

    taxel: str
    dead: _Verdict
    stuck: _Verdict


class OffsetDocument(TypedDict):
    """The middle of what the clock states minus the true time, ns; ``null``: not bounded."""

    lo_ns: int | None
    hi_ns: int | None


class ClockDocument(TypedDict):
    """Whether the node's statement of UTC in its latest status holds, by what messages prove."""

    verdict: _Verdict
    offset: OffsetDocument
    references_agree: bool


class MissingRangeDocument(TypedDict):
    """Numbers of messages of one boot, the last one included."""

    boot: int
    first: int
    last: int


class MissingDocument(TypedDict):
    """Messages that the node made and that are stored nowhere, though no gap names them.

    ``ranges`` are the latest ones, at most 16.
    """

    messages: int
    since: Instant
    ranges: list[MissingRangeDocument]


class NodeDocument(TypedDict):
    """A node."""

    id: str
    health: Health
    last_seen: Instant
    boot: int
    sequence: int | None
    profile: str | None
    description: str | None
    uptime_ns: int | None
    outbox: OutboxDocument | None
    gaps: int
    energy: EnergyDocument | None
    faults: list[FaultDocument] | None
    channels: int | None
    layout: str | None
    lag: LagDocument | None
    clock: ClockDocument | None
    missing: MissingDocument | None


class RemovedDocument(TypedDict):
    """What retention or erasure removed of a patch: how many messages, all before when."""

    messages: int
    before: Instant


class ChannelDocument(TypedDict):
    """A channel: a column of the patch ``patch``.

    ``first`` and ``last`` are those of all frames of its page; of a biometric channel, whole
    minutes around the times that these frames state. ``dt`` is the period of the last samples, ns;
    null if it is unknown, as of a biometric channel.
    """

    id: str
    taxel: str
    quantity: str
    unit: str
    coverage: float
    dt: int | None
    first: Instant | None
    last: Instant | None
    biometric: bool
    patch: str
    removed: RemovedDocument | None


def describe_node(
    row: Row,
    *,
    channels: int | None,
    health: Health,
    clock_error_s: float,
    holes: Sequence[MissingSpan] = (),
    counted: bool = True,
) -> NodeDocument:
    """A node; unless ``counted``, without what would disclose when its sealed messages come."""
    outbox: OutboxDocument = {
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
        "energy": _energy(row),
        "faults": None if row["faults"] is None else json.loads(row["faults"]),
        "channels": channels,
        "layout": None if row["layout"] is None else bytes(row["layout"]).hex(),
        "lag": lag(row) if counted else None,
        "clock": _clock(row, clock_error_s),
        "missing": _missing(holes),
    }


def describe_channel(
    row: Row, removed: tuple[int, int] | None, *, counted: bool = True
) -> ChannelDocument:
    """A channel; ``removed`` is how many messages went, and before when.

    Unless ``counted``, times of a biometric channel are null, and what was removed.
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
        "dt": row["dt"] or None,
        "first": None if hidden else instant(row["t_first"]),
        "last": None if hidden else instant(row["t_last"]),
        "biometric": biometric,
        "patch": row["patch"],
        "removed": None
        if removed is None or hidden
        else {"messages": removed[0], "before": format_timestamp(removed[1])},
    }


def _missing(holes: Sequence[MissingSpan]) -> MissingDocument | None:
    """What is missing of a node, as events name it."""
    named = [hole for hole in holes if hole.reported]
    if not named:
        return None
    ranges: list[MissingRangeDocument] = [
        {"boot": h.boot, "first": h.first, "last": h.last} for h in named[-_MOST_RANGES:]
    ]
    return {
        "messages": sum(hole.messages for hole in named),
        "since": format_timestamp(min(hole.since for hole in named)),
        "ranges": ranges,
    }


def _clock(row: Row, error_s: float) -> ClockDocument | None:
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


def judge_health(judged: NodesSection, silence: float, *, ahead: float = 0.0) -> Health:
    """Judge a node or gateway by the seconds since its last message.

    A last message so many seconds ahead of the clock came before the clock was set back. It says
    nothing about the present.
    """
    if silence >= judged.silence_s or ahead >= judged.silence_s:
        return "offline"
    return "online" if silence < judged.late_s else "late"


def _energy(row: Row) -> EnergyDocument | None:
    if row["shedding"] is None:
        return None
    return {
        "stored": {"lo": row["stored_lo"], "hi": row["stored_hi"]},
        "charge": {"lo": row["charge_lo"], "hi": row["charge_hi"]},
        "self_sustaining": cast("_Verdict", Verdict(row["sustained"]).name.lower()),
        "shedding": cast("_Shedding", Shedding(row["shedding"]).name.lower()),
    }
