"""Two channels compared: monitors of one comparison, without a formula to write."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field
from starlette.responses import Response

from eskin.monitor import Channel, Formula
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.verdict_answers import list_verdicts, total_time
from eskin_cloud.api.window_params import PagedWindowQuery, WindowQuery
from eskin_cloud.schemas.base import PageDocument, Place
from eskin_cloud.schemas.monitors import TotalsDocument, VerdictDocument
from eskin_cloud.store.read.lookup import parse_channel

router = APIRouter(tags=["monitors"])


class ComparisonQuery(WindowQuery):
    """Which channel is compared with which; without a window, the last minute that both have."""

    other: Place = Field(max_length=200, description="the other channel, as NODE/CHANNEL")
    state: Literal["above", "below"] = Field(
        default="above", description="whether the channel is asked to be above the other, or below"
    )

    def formula(self) -> Formula:
        """The comparison of a channel ``c`` with another one, ``d``."""
        one, other = Channel("c"), Channel("d")
        return one > other if self.state == "above" else one < other

    def places(self, node: str, channel: str) -> dict[str, tuple[str, str]]:
        """Node and channel of both."""
        return {"c": (node, channel), "d": parse_channel(self.other, "other")}


class StretchesQuery(ComparisonQuery, PagedWindowQuery):
    """Parameters of a comparison's stretches."""


@router.get(
    "/series/{node}/{channel}/comparison",
    response_model=PageDocument[VerdictDocument],
    responses=REFUSALS_OF_PLACE,
)
def get_comparison(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[StretchesQuery, Query()],
) -> Response:
    """List when a channel is above or below another one."""
    return list_verdicts(cloud, access, query.formula(), query.places(node, channel), query)


@router.get("/series/{node}/{channel}/comparison/time", responses=REFUSALS_OF_PLACE)
def get_comparison_time(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[ComparisonQuery, Query()],
) -> TotalsDocument:
    """Measure how long a channel is above or below another one."""
    return total_time(cloud, access, query.formula(), query.places(node, channel), query)
