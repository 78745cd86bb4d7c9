"""When a channel is not as predicted, certainly or possibly: runs of samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from sqlalchemy import func, select, tuple_

from cloud.pyramid.blocks import DECODED, decode
from cloud.pyramid.pieces import concatenated
from cloud.query.around import COLUMNS, as_pieces
from cloud.query.holding import after, before
from cloud.query.question import Answer, Question
from cloud.query.runs import find_runs, parted
from cloud.query.span import touching
from cloud.store.schema import blocks
from eskin.errors import QueryError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sqlalchemy import Connection, RowMapping

    from cloud.pyramid.pieces import Pieces
    from cloud.query.prediction import Prediction
    from cloud.query.runs import Run
    from cloud.query.window import Window

MOST: Final = 100_000
"""Most blocks that are compared with a prediction that changes, for one question."""
_AT_ONCE: Final = 256


def find_anomalies(
    connection: Connection, channel: RowMapping, window: Window, prediction: Prediction
) -> Iterator[Run]:
    """All runs in a window, in order of time: anomalies or not.

    What is predicted for a sample takes in its time error. A band that stands is asked of the
    pyramid first, what changes of each block's bounds.

    Raises:
        QueryError: There is too much to be compared, or the model does not take its parameters.
    """
    if prediction.model.name == "constant":
        band = prediction.parameters["value"]
        question = Question(float(band.inf), float(band.sup), outside=True)
        return find_runs(connection, channel, window, question, over_gaps=False)
    here = touching(channel, window)
    if connection.execute(select(func.count()).where(here)).scalar_one() > MOST:
        raise QueryError("start", f"to end are over {MOST} blocks; ask for less at once")
    return _find(connection, channel, window, prediction)


def _find(
    connection: Connection, channel: RowMapping, window: Window, prediction: Prediction
) -> Iterator[Run]:
    for rows in _batches(connection, channel, window):
        pieces = as_pieces(rows)
        whole = (pieces.first >= window.start) & (pieces.last < window.end)
        whole[1:] &= pieces.first[1:] > np.maximum.accumulate(pieces.last)[:-1]
        whole[:-1] &= pieces.last[:-1] < pieces.first[1:]
        # Of a block that is all disjoint nothing more is asked.
        known = whole & ((_answers(prediction, pieces) == Answer.CERTAIN) | (pieces.n == 1))
        samples = _decoded(
            connection, channel, window, [rows[k] for k in np.flatnonzero(~known).tolist()]
        )
        mixed = concatenated([pieces[known], samples])
        if len(mixed):
            yield from parted(mixed, _answers(prediction, mixed))


def _answers(prediction: Prediction, pieces: Pieces) -> Any:
    first, last = before(pieces.first, pieces.error), after(pieces.last, pieces.error)
    return prediction.answers(first, last, pieces.lo, pieces.hi)


def _batches(
    connection: Connection, channel: RowMapping, window: Window
) -> Iterator[Sequence[RowMapping]]:
    """Blocks in order of time; those that overlap each other come together."""
    b = blocks.c
    query = select(*COLUMNS).where(touching(channel, window)).order_by(b.t, b.boot, b.sequence)
    batch: list[RowMapping] = []
    end = 0
    for row in connection.execute(query).mappings().yield_per(_AT_ONCE):
        if len(batch) >= _AT_ONCE and row["t"] > end:
            yield batch
            batch = []
        end = max(end, row["t_end"]) if batch else row["t_end"]
        batch.append(row)
    if batch:
        yield batch


def _decoded(
    connection: Connection, channel: RowMapping, window: Window, rows: Sequence[RowMapping]
) -> Pieces:
    b = blocks.c
    keys = [(channel["node"], row["boot"], row["sequence"]) for row in rows]
    query = select(*DECODED).where(tuple_(b.node, b.boot, b.sequence).in_(keys))
    return decode(connection.execute(query.order_by(b.t, b.boot, b.sequence)).all(), window)
