"""Answers about a channel's samples."""

from typing import Literal

from pydantic import BaseModel

from eskin.wire.timestamp import format_timestamp
from eskin_cloud.query.series import Series
from eskin_cloud.schemas.base import Instant, Json


class BoundsDocument(BaseModel):
    """Lower and upper bounds, one of each for each entry of a series."""

    lo: list[float | None]
    hi: list[float | None]


class SeriesDocument(BaseModel):
    """A series.

    Where one of lo and hi is null, that side is unbounded; where both are, nothing is known. A
    sample holds at its instant, a hull over ``[t, t + dt)``; ``mean`` encloses the mean of each
    hull's samples, and is null where entries are samples.
    """

    node: str
    channel: str
    unit: str
    coverage: float
    resolution: Literal["sample", "hull"]
    t0: Instant
    t: list[int]
    lo: list[float | None]
    hi: list[float | None]
    mean: BoundsDocument | None
    dt: int
    time_error: int


def describe_series(series: Series) -> Json:
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
