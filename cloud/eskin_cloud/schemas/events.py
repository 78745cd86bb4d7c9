"""Events, and frames sample by sample."""

from collections.abc import Iterator
from typing import Literal, TypeAlias

import numpy as np
from typing_extensions import TypedDict

from eskin.wire.frames import DescribedLayout, Frame
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
    number = row.get("number", 0)
    return {
        "id": ids.write(row["cursor"], *([number] if number else [])),
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


def describe_columns(node: str, frame: Frame, described: DescribedLayout) -> Iterator[Json]:
    """The samples of each channel of a frame.

    Sample k was taken in ``time`` moved by ``k·dt`` ns.
    """
    for samples, values in zip(frame.patches, frame.values, strict=True):
        patch, grid = described.patches[samples.patch], frame.grids[samples.grid]
        for column, channel in enumerate(patch.channels):
            step = 1 << samples.strides[column] if samples.strides else 1
            first = -grid.first_row % step
            if first >= grid.rows:
                continue  # not sampled in this frame
            after = grid.delay + first * grid.period + (patch.skew[column] if patch.skew else 0)
            yield {
                "node": node,
                "channel": channel,
                "kind": "frame",
                "time": time_span(frame.time[0] + after, frame.time[1] + after),
                "dt": grid.period * step,
                "unit": patch.unit,
                "coverage": grid.coverage,
                "lo": np.ascontiguousarray(values.inf[first::step, column]),
                "hi": np.ascontiguousarray(values.sup[first::step, column]),
                "boot": frame.position.boot,
                "sequence": frame.position.sequence,
            }
