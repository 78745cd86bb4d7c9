"""Find segments in which a channel differs from a prediction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.errors import QueryError
from eskin_cloud.query.predicate import Predicate
from eskin_cloud.query.sample_validity import after, before
from eskin_cloud.query.segments import find_segments_of, parted
from eskin_cloud.rollup.samples import read_samples
from eskin_cloud.store.read.patch_columns import split_column

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection

    from eskin_cloud.query.prediction import Prediction
    from eskin_cloud.query.segments import Segment
    from eskin_cloud.store.read.lookup import Channel
    from eskin_cloud.store.read.window import Window

MOST: Final = 10_000_000
"""Most samples that a query compares with a changing prediction."""


def find_anomalies(
    connection: Connection, channel: Channel, window: Window, prediction: Prediction
) -> Iterator[Segment]:
    """All segments of a window, in order of time.

    A prediction for a sample includes its time error. A constant band is compared with tiles first,
    a changing prediction with each sample.

    Raises:
        QueryError: The window holds too many samples, or a parameter is invalid.
    """
    if prediction.model.name == "constant":
        band = prediction.parameters["value"]
        question = Predicate(float(band.inf), float(band.sup), outside=True)
        return find_segments_of(connection, channel, window, question)
    return _find(connection, channel, window, prediction)


def _find(
    connection: Connection, channel: Channel, window: Window, prediction: Prediction
) -> Iterator[Segment]:
    left = MOST
    for part in split_column(connection, channel, window):
        samples = read_samples(connection, channel, part)
        left -= len(samples)
        if left < 0:
            raise QueryError("start", f"to end are over {MOST} samples; choose a shorter window")
        if len(samples):
            first = before(samples.first, samples.error)
            last = after(samples.last, samples.error)
            yield from parted(samples, prediction.answers(first, last, samples.lo, samples.hi))
