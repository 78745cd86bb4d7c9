"""Questions that compare a channel with what a ³S model predicts for it."""

from collections.abc import Iterator
from typing import Annotated, Final, Literal

import numpy as np
from fastapi import APIRouter, Query
from pydantic import BaseModel, Field
from starlette.responses import Response

from eskin.errors import IntervalError, QueryError
from eskin.interval import Interval, Verdict
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json
from eskin_cloud.api.window_params import WindowQuery, opened, paged, window_of
from eskin_cloud.query.anomalies import find_anomalies
from eskin_cloud.query.cursors import read_numbers
from eskin_cloud.query.models import MODELS
from eskin_cloud.query.occupancy import total_occupancy
from eskin_cloud.query.parse_decimal import enclose_decimal
from eskin_cloud.query.prediction import Prediction
from eskin_cloud.query.sample_validity import after
from eskin_cloud.query.segments import Segment, merge
from eskin_cloud.rollup.hulls import bucket_width
from eskin_cloud.schemas.base import TIME, Moment, PageDocument, Time, page
from eskin_cloud.schemas.series import (
    OccupancyDocument,
    SegmentDocument,
    describe_occupancy,
    describe_segment,
)
from eskin_cloud.store.read.lookup import Channel, find_channel
from eskin_cloud.store.read.patch_columns import find_next
from eskin_cloud.store.read.window import make_window, parse_time

router = APIRouter(tags=["series"])

_MOST_PARAMETERS: Final = 20


class PredictionQuery(WindowQuery):
    """Which model predicts, and with which parameters."""

    model: Literal[tuple(MODELS)] = Field(  # type: ignore[valid-type]  # names of the registry
        description="a quantity of a model"
    )
    parameter: list[Annotated[str, Field(max_length=100)]] = Field(
        default=[],
        max_length=_MOST_PARAMETERS,
        description="NAME:LO:HI or NAME:VALUE, in SI units, rounded outward; may be repeated",
    )
    origin: Time | None = Field(
        default=None, description=f"the model's time 0; {TIME}; else `start`"
    )


class TubeQuery(PredictionQuery):
    """Parameters of a predicted tube."""

    points: int = Field(default=1000, ge=1, le=20_000, description="buckets, at most")


class AnomaliesQuery(PredictionQuery):
    """Parameters of anomalies."""

    limit: int = Field(default=1000, ge=1, le=10_000, description="segments at once")
    cursor: str | None = Field(default=None, max_length=1000, description="what `next` said")


class PredictionDocument(BaseModel):
    """A predicted tube: an enclosure of all that is predicted in each ``[t, t + dt]``."""

    node: str
    channel: str
    model: str
    unit: str
    origin: Moment
    t0: Moment
    t: list[int]
    lo: list[float | None]
    hi: list[float | None]
    dt: int


@router.get(
    "/series/{node}/{channel}/prediction",
    response_model=PredictionDocument,
    responses=REFUSALS_OF_PLACE,
)
def get_prediction(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[TubeQuery, Query()],
) -> Response:
    """Predict a channel by a model, as hulls."""
    with cloud.store.read() as connection:
        row = find_channel(connection, node, channel)
        window = window_of(cloud, row, query)
        with opened(cloud, access, connection, row, window) as (_, known):
            prediction = _prediction(query, known, window.start)
    width = bucket_width(window.span, query.points)
    t = width * np.arange(-(-window.span // width), dtype=np.int64)
    begun = window.start + t
    lo, hi = prediction.between(begun, after(begun, np.full_like(t, width)))
    return as_json(
        {
            "node": node,
            "channel": channel,
            "model": query.model,
            "unit": known["unit"],
            "origin": format_timestamp(prediction.origin),
            "t0": format_timestamp(window.start),
            "t": t,
            "lo": np.ascontiguousarray(lo),
            "hi": np.ascontiguousarray(hi),
            "dt": width,
        }
    )


@router.get(
    "/series/{node}/{channel}/anomalies",
    response_model=PageDocument[SegmentDocument],
    responses=REFUSALS_OF_PLACE,
)
def get_anomalies(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[AnomaliesQuery, Query()],
) -> Response:
    """List when a channel differs from a model's prediction."""
    with cloud.store.read() as connection:
        row = find_channel(connection, node, channel)
        if query.cursor is None:
            window = window_of(cloud, row, query)
            origin = window.start
        else:
            start, end, origin = read_numbers(query.cursor, 3)
            window = make_window(start, end)
        with opened(cloud, access, connection, row, window) as (source, known):
            prediction = _prediction(query, known, origin)
            runs = merge(find_anomalies(source, known, window, prediction))
            found, following = paged(_not_impossible(runs), window, query.limit, prediction.origin)
    return as_json(page([describe_segment(run) for run in found], following))


@router.get(
    "/series/{node}/{channel}/anomalies/time",
    responses=REFUSALS_OF_PLACE,
)
def get_anomalies_time(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[PredictionQuery, Query()],
) -> OccupancyDocument:
    """Measure how long and how often a channel differs from a model."""
    with cloud.store.read() as connection:
        row = find_channel(connection, node, channel)
        window = window_of(cloud, row, query)
        with opened(cloud, access, connection, row, window) as (source, known):
            prediction = _prediction(query, known, window.start)
            runs = find_anomalies(source, known, window, prediction)
            found = total_occupancy(runs, window, find_next(source, known, window.end))
    return describe_occupancy(found, window, known)


def _not_impossible(runs: Iterator[Segment]) -> Iterator[Segment]:
    return (run for run in runs if run.answer is not Verdict.IMPOSSIBLE)


def _prediction(query: PredictionQuery, row: Channel, start: int) -> Prediction:
    """What is asked for."""
    model = MODELS[query.model]
    if model.unit is not None and model.unit != row["unit"]:
        raise QueryError(
            "model",
            f"{query.model} is in {model.unit}, {row['node']}/{row['channel']} in {row['unit']}; "
            "take a model of the same unit",
        )
    parameters = dict(_parameter(text) for text in query.parameter)
    if len(parameters) < len(query.parameter):
        raise QueryError("parameter", "one is given twice; give each once")
    model.require_parameters(parameters)
    given = parse_time("origin", query.origin)
    return Prediction(model, parameters, start if given is None else given)


def _parameter(text: str) -> tuple[str, Interval]:
    """Name and bounds, rounded outward: what the text says lies in them."""
    name, *bounds = text.split(":")
    try:
        lo, *rest = (enclose_decimal(bound) for bound in bounds)
        (hi,) = rest or (lo,)
        return name, Interval(lo[0], hi[1])
    except (ValueError, IntervalError) as error:
        raise QueryError(
            "parameter", f"{text!r} is no NAME:LO:HI such as distance:0.9e-3:1.1e-3"
        ) from error
