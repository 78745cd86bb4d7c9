"""Events, and blocks sample by sample."""

from typing import Literal, TypeAlias

from typing_extensions import TypedDict

from eskin.wire.messages import Block
from eskin_cloud.query.opaque_ids import OpaqueIds
from eskin_cloud.schemas.base import IntervalDocument, Json, Row, TimeDocument, interval, time_span

EventKind: TypeAlias = Literal["peak", "gap", "contact", "verdict", "status", "command", "conflict"]


class EventDocument(TypedDict):
    """An event."""

    id: str
    node: str
    channel: str | None
    kind: EventKind
    verdict: Literal["certain", "possible", "impossible"] | None
    time: TimeDocument
    height: IntervalDocument | None
    prominence: IntervalDocument | None
    count: IntervalDocument | None
    unit: str | None
    coverage: float | None
    boot: int
    detail: str | None


def describe_event(row: Row, ids: OpaqueIds) -> EventDocument:
    """An event; without its sequence number, which would count what is sealed."""
    return {
        "id": ids.write(row["cursor"]),
        "node": row["node"],
        "channel": row["channel"],
        "kind": row["kind"],
        "verdict": row["verdict"],
        "time": time_span(row["t_lo"], row["t_hi"]),
        "height": interval(row["height_lo"], row["height_hi"]),
        "prominence": interval(row["prominence_lo"], row["prominence_hi"]),
        "count": interval(row["count_lo"], row["count_hi"]),
        "unit": row["unit"],
        "coverage": row["coverage"],
        "boot": row["boot"],
        "detail": row["detail"],
    }


def describe_block(node: str, block: Block) -> Json:
    """A block, sample by sample; sample k was taken in ``time`` moved by ``k·dt`` ns."""
    tube = block.tube
    return {
        "node": node,
        "channel": block.channel,
        "kind": "block",
        "time": time_span(*tube.time),
        "dt": tube.dt,
        "unit": tube.unit,
        "coverage": tube.coverage,
        "lo": tube.values.inf,
        "hi": tube.values.sup,
        "boot": block.position.boot,
        "sequence": block.position.sequence,
    }
