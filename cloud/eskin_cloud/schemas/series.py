"""The shapes of answers about a channel's samples, for the OpenAPI description."""

from typing import Literal

from pydantic import BaseModel

from eskin_cloud.schemas.documents import IntervalDocument, Moment


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
    t0: Moment
    t: list[int]
    lo: list[float | None]
    hi: list[float | None]
    mean: BoundsDocument | None
    dt: int
    time_error: int


class SegmentDocument(BaseModel):
    """A run of samples, from the first to the last, with the same answer.

    ``coverage`` is the probability of the whole statement: the union bound over its samples. Their
    true moments lie within ``time_error`` ns of those that are told.
    """

    id: str
    start: Moment
    end: Moment
    verdict: Literal["certain", "possible"]
    coverage: float
    time_error: int


class CountDocument(BaseModel):
    """How many, at least and at most."""

    lo: int
    hi: int


class OccupancyDocument(BaseModel):
    """For how long and how often a channel is in a state, over a window.

    A sample holds until the next, for its period at most; for ``unknown_s`` nothing is known.
    ``samples`` and ``entries`` count what is known: samples in the state, and how often it began.
    Samples are those that are told within the window; their true moments lie within ``time_error``
    ns of these, and ``time_s`` holds wherever they do. ``coverage`` is the probability of the whole
    statement.
    """

    start: Moment
    end: Moment
    unit: str
    time_s: IntervalDocument
    unknown_s: float
    samples: CountDocument
    entries: CountDocument
    coverage: float
    time_error: int
