"""Questions that compare a channel with what a ³S model predicts for it."""

from collections.abc import Iterator
from contextlib import contextmanager
from decimal import Decimal
from typing import Annotated, Final, Literal

import numpy as np
from fastapi import APIRouter, Query
from pydantic import BaseModel, Field
from starlette.responses import Response

from eskin.errors import MonitorError, QueryError
from eskin.monitor import Constant, Deviation, Formula, Prediction, PredictionParameter
from eskin.monitor.predicted_quantities import MODELS
from eskin.wire.timestamp import MOST_INSTANT, format_timestamp
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json
from eskin_cloud.api.verdict_answers import list_verdicts, total_time
from eskin_cloud.api.window_params import PagedWindowQuery, WindowQuery, opened, window_of
from eskin_cloud.rollup.hulls import bucket_width
from eskin_cloud.schemas.base import TIME, Instant, PageDocument, Time
from eskin_cloud.schemas.monitors import TotalsDocument, VerdictDocument
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import parse_time

router = APIRouter(tags=["monitors"])

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
        default=None, description=f"the model's time 0; {TIME}; else `start`; a constant needs none"
    )


class TubeQuery(PredictionQuery):
    """Parameters of a predicted tube."""

    points: int = Field(default=1000, ge=1, le=20_000, description="buckets, at most")


class AnomaliesQuery(PredictionQuery, PagedWindowQuery):
    """Parameters of anomalies."""


class PredictionDocument(BaseModel):
    """A predicted tube: an enclosure of all that is predicted in each ``[t, t + dt]``."""

    node: str
    channel: str
    model: str
    unit: str
    origin: Instant
    t0: Instant
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
            unit = known["unit"]
    prediction = _prediction(query)
    width = bucket_width(window.span, query.points)
    t = width * np.arange(-(-window.span // width), dtype=np.int64)
    begun = window.start + t
    with _refused("model"):
        lo, hi = prediction.between(begun, np.minimum(begun, MOST_INSTANT - width) + width, unit)
    return as_json(
        {
            "node": node,
            "channel": channel,
            "model": query.model,
            "unit": unit,
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
    response_model=PageDocument[VerdictDocument],
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
    return list_verdicts(cloud, access, _anomaly(query), {"c": (node, channel)}, query)


@router.get("/series/{node}/{channel}/anomalies/time", responses=REFUSALS_OF_PLACE)
def get_anomalies_time(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[PredictionQuery, Query()],
) -> TotalsDocument:
    """Measure how long and how often a channel differs from a model."""
    return total_time(cloud, access, _anomaly(query), {"c": (node, channel)}, query)


def _anomaly(query: PredictionQuery) -> Formula:
    """Whether a channel ``c`` is outside of what is predicted."""
    return Deviation(source="c", prediction=_prediction(query)) > 0


def _prediction(query: PredictionQuery) -> Prediction:
    """What is asked for."""
    origin = parse_time("origin", query.origin)
    if origin is None:
        origin = parse_time("start", query.start)
    if origin is None and query.model != "constant":
        raise QueryError("origin", "is missing; give the model's time 0, or `start`")
    parameters = tuple(_parameter(text) for text in query.parameter)
    with _refused("parameter"):
        return Prediction(query.model, parameters, origin or 0)


@contextmanager
def _refused(parameter: str) -> Iterator[None]:
    """Name the parameter of a question that a monitor refuses."""
    try:
        yield
    except MonitorError as error:
        raise QueryError(parameter, str(error)) from error


def _parameter(text: str) -> PredictionParameter:
    """Name and bounds, exactly as the text says."""
    name, *bounds = text.split(":")
    try:
        lo, *rest = (Constant(Decimal(bound.strip())).value for bound in bounds)
        (hi,) = rest or (lo,)
    except (ValueError, ArithmeticError) as error:
        raise QueryError(
            "parameter", f"{text!r} is no NAME:LO:HI such as distance:0.9e-3:1.1e-3"
        ) from error
    return PredictionParameter(name, lo, hi)
