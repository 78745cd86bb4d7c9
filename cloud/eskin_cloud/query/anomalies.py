"""Find segments in which a channel differs from a prediction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from sqlalchemy import func, select, tuple_

from eskin.errors import QueryError
from eskin.interval import Verdict
from eskin_cloud.query.predicate import Predicate
from eskin_cloud.query.sample_validity import after, before
from eskin_cloud.query.segments import find_segments_of, parted
from eskin_cloud.rollup.aggregates import concatenated
from eskin_cloud.rollup.blocks import DECODED, decode, of_headers, read_samples
from eskin_cloud.store.damage import intact_headers
from eskin_cloud.store.read.block_index import HEADER_COLUMNS, overlaps
from eskin_cloud.store.read.patch_columns import is_column, split_column
from eskin_cloud.store.schema.tables import blocks

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.query.prediction import Prediction
    from eskin_cloud.query.segments import Segment
    from eskin_cloud.rollup.aggregates import Aggregates
    from eskin_cloud.store.read.lookup import Channel
    from eskin_cloud.store.read.window import Window

MOST: Final = 100_000
"""Most blocks that a query compares with a changing prediction."""
_MOST_SAMPLES: Final = 10_000_000
"""Most samples of a channel of frames that a query compares with a changing prediction."""
_AT_ONCE: Final = 256


def find_anomalies(
    connection: Connection, channel: Channel, window: Window, prediction: Prediction
) -> Iterator[Segment]:
    """All segments of a window, in order of time.

    A prediction for a sample includes its time error. A constant band is compared with tiles first,
    a changing prediction with each block's bounds.

    Raises:
        QueryError: The window holds too many blocks, or a parameter is invalid.
    """
    if prediction.model.name == "constant":
        band = prediction.parameters["value"]
        question = Predicate(float(band.inf), float(band.sup), outside=True)
        return find_segments_of(connection, channel, window, question)
    if is_column(channel):
        return _of_column(connection, channel, window, prediction)
    here = overlaps(channel, window)
    if connection.execute(select(func.count()).where(here)).scalar_one() > MOST:
        raise QueryError("start", f"to end are over {MOST} blocks; choose a shorter window")
    return _find(connection, channel, window, prediction)


def _of_column(
    connection: Connection, channel: Channel, window: Window, prediction: Prediction
) -> Iterator[Segment]:
    left = _MOST_SAMPLES
    for part in split_column(connection, channel, window):
        samples = read_samples(connection, channel, part)
        left -= len(samples)
        if left < 0:
            raise QueryError(
                "start", f"to end are over {_MOST_SAMPLES} samples; choose a shorter window"
            )
        if len(samples):
            yield from parted(samples, _answers(prediction, samples))


def _find(
    connection: Connection, channel: Channel, window: Window, prediction: Prediction
) -> Iterator[Segment]:
    for rows in _batches(connection, channel, window):
        pieces = of_headers(rows)
        whole = (pieces.first >= window.start) & (pieces.last < window.end)
        whole[1:] &= pieces.first[1:] > np.maximum.accumulate(pieces.last)[:-1]
        whole[:-1] &= pieces.last[:-1] < pieces.first[1:]
        # A block that is disjoint as a whole is not decoded.
        known = whole & ((_answers(prediction, pieces) == Verdict.CERTAIN) | (pieces.n == 1))
        samples = _decoded(
            connection, channel, window, [rows[k] for k in np.flatnonzero(~known).tolist()]
        )
        mixed = concatenated([pieces[known], samples])
        if len(mixed):
            yield from parted(mixed, _answers(prediction, mixed))


def _answers(prediction: Prediction, pieces: Aggregates) -> Any:
    first, last = before(pieces.first, pieces.error), after(pieces.last, pieces.error)
    return prediction.answers(first, last, pieces.lo, pieces.hi)


def _batches(
    connection: Connection, channel: Channel, window: Window
) -> Iterator[Sequence[RowMapping]]:
    """Batches of blocks in order of time; overlapping blocks are in one batch."""
    b = blocks.c
    query = (
        select(*HEADER_COLUMNS).where(overlaps(channel, window)).order_by(b.t, b.boot, b.sequence)
    )
    batch: list[RowMapping] = []
    end = 0
    for row in intact_headers(connection.execute(query).mappings().yield_per(_AT_ONCE)):
        if len(batch) >= _AT_ONCE and row["t"] > end:
            yield batch
            batch = []
        end = max(end, row["t_end"]) if batch else row["t_end"]
        batch.append(row)
    if batch:
        yield batch


def _decoded(
    connection: Connection, channel: Channel, window: Window, rows: Sequence[RowMapping]
) -> Aggregates:
    b = blocks.c
    keys = [(channel["node"], row["boot"], row["sequence"]) for row in rows]
    query = select(*DECODED).where(tuple_(b.node, b.boot, b.sequence).in_(keys))
    return decode(connection.execute(query.order_by(b.t, b.boot, b.sequence)).all(), window)
