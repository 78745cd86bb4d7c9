"""Thresholds: monitors of one comparison with a constant, without a formula to write."""

from fractions import Fraction
from typing import Annotated, Self

from fastapi import APIRouter, Query
from pydantic import Field, model_validator
from starlette.responses import Response

from eskin.errors import QueryError
from eskin.monitor import Channel, Constant, Formula
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.verdict_answers import list_verdicts, total_time
from eskin_cloud.api.window_params import PagedWindowQuery, WindowQuery
from eskin_cloud.schemas.base import PageDocument
from eskin_cloud.schemas.monitors import TotalsDocument, VerdictDocument

router = APIRouter(tags=["monitors"])


class StateQuery(WindowQuery):
    """Which state is asked for: above or below a value, or in a band, its ends included."""

    above: float | None = Field(default=None, allow_inf_nan=False, description="in the unit")
    below: float | None = Field(default=None, allow_inf_nan=False, description="in the unit")
    at_least: float | None = Field(default=None, allow_inf_nan=False, description="of a band")
    at_most: float | None = Field(default=None, allow_inf_nan=False, description="of a band")
    outside: bool = Field(default=False, description="asks for outside of the band instead")

    @model_validator(mode="after")
    def _one_state(self) -> Self:
        band = self.at_least is not None, self.at_most is not None
        if (self.above is not None) + (self.below is not None) + any(band) != 1:
            raise QueryError(
                "above, below", "give either above or below, or at_least and at_most for a band"
            )
        if any(band) and not all(band):
            raise QueryError("at_least, at_most", "give both ends of the band")
        if self.outside and not all(band):
            raise QueryError("outside", "needs a band: give at_least and at_most, too")
        if self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            raise QueryError("at_least", "is greater than at_most; swap them")
        return self

    def formula(self) -> Formula:
        """The state of a channel ``c``; a number is the float that it was read as."""
        value = Channel("c")
        if self.above is not None:
            return value > _exact(self.above)
        if self.below is not None:
            return value < _exact(self.below)
        low, high = _exact(self.at_least or 0.0), _exact(self.at_most or 0.0)
        return (value < low) | (value > high) if self.outside else (value >= low) & (value <= high)


class ThresholdQuery(StateQuery, PagedWindowQuery):
    """Parameters of a threshold."""


def _exact(bound: float) -> Constant:
    return Constant(Fraction(bound))


@router.get(
    "/series/{node}/{channel}/threshold",
    response_model=PageDocument[VerdictDocument],
    responses=REFUSALS_OF_PLACE,
)
def get_threshold(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[ThresholdQuery, Query()],
) -> Response:
    """List when a channel is above, below, within or outside of values."""
    return list_verdicts(cloud, access, query.formula(), {"c": (node, channel)}, query)


@router.get("/series/{node}/{channel}/time", responses=REFUSALS_OF_PLACE)
def get_time(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[StateQuery, Query()],
) -> TotalsDocument:
    """Measure how long and how often a channel is in a state."""
    return total_time(cloud, access, query.formula(), {"c": (node, channel)}, query)
