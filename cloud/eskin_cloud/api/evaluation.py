"""Formulas over stored channels."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field
from starlette.responses import Response

from eskin.interval import Verdict
from eskin.monitor import Formula
from eskin.wire.messages.command import MOST_FORMULA
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.verdict_answers import list_verdicts, total_time
from eskin_cloud.api.window_params import PagedWindowQuery, WindowQuery
from eskin_cloud.query.formula_channels import channel_places, parse_formula
from eskin_cloud.query.stored_verdicts import StoredPiece
from eskin_cloud.schemas.base import PageDocument
from eskin_cloud.schemas.monitors import FormulaTotalsDocument, VerdictDocument

router = APIRouter(tags=["monitors"])


class FormulaQuery(WindowQuery):
    """A formula, and where its channels are; without a window, the last minute of their data."""

    formula: str = Field(
        min_length=1,
        max_length=MOST_FORMULA,
        description="signal temporal logic over channels, with bounded windows",
        examples=["always[0,50ms](t01.capacitance > 50 pF)"],
    )
    node: str | None = Field(
        default=None,
        max_length=63,
        description='of channels without one; others are "NODE/CHANNEL", in double quotes',
    )

    def parsed(self) -> Formula:
        """The formula."""
        return parse_formula(self.formula)

    def places(self, formula: Formula) -> dict[str, tuple[str, str]]:
        """Node and channel of each channel that a formula measures, by its name there."""
        return channel_places(formula, self.node)


class EvaluationQuery(FormulaQuery, PagedWindowQuery):
    """Which stretches of a formula are listed."""

    verdict: Literal["certain", "possible", "impossible"] | None = Field(
        default=None, description="only stretches with this one"
    )

    def wanted(self, piece: StoredPiece) -> bool:
        """Whether a stretch is listed."""
        return self.verdict is None or piece.verdict is Verdict[self.verdict.upper()]


@router.get(
    "/monitors/evaluation",
    response_model=PageDocument[VerdictDocument],
    responses=REFUSALS_OF_PLACE,
)
def get_evaluation(
    cloud: CloudState, access: Reader, query: Annotated[EvaluationQuery, Query()]
) -> Response:
    """List when a formula over stored channels is certain, possible and impossible.

    Hulls of the pyramid are read first, and samples only where those do not decide. A page may be
    short, or empty, with a ``next`` that continues: then much stays open, and the answer takes
    several requests.
    """
    formula = query.parsed()
    places = query.places(formula)
    return list_verdicts(cloud, access, formula, places, query, wanted=query.wanted)


@router.get("/monitors/evaluation/time", responses=REFUSALS_OF_PLACE)
def get_evaluation_time(
    cloud: CloudState, access: Reader, query: Annotated[FormulaQuery, Query()]
) -> FormulaTotalsDocument:
    """Measure for how long, and how often, a formula holds."""
    formula = query.parsed()
    return total_time(cloud, access, formula, query.places(formula), query)
