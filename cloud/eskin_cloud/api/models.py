"""Which models channels may be compared with."""

from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from eskin.monitor.predicted_quantities import MODELS
from eskin_cloud.api.dependencies import Reader
from eskin_cloud.api.problems import REFUSALS
from eskin_cloud.schemas.base import IntervalDocument, NoQuery, PageDocument, interval

router = APIRouter(tags=["monitors"])


class ParameterDocument(BaseModel):
    """A parameter of a model; ``usual`` are bounds to begin with."""

    name: str
    unit: str | None = Field(description="UCUM code; null for the channel's own")
    required: bool
    usual: IntervalDocument | None


class ModelDocument(BaseModel):
    """A quantity of a model."""

    id: str
    unit: str | None = Field(description="UCUM code; null for any")
    description: str
    parameters: list[ParameterDocument]


@router.get("/models", responses=REFUSALS)
def get_models(_: Reader, query: Annotated[NoQuery, Query()]) -> PageDocument[ModelDocument]:
    """List the models' quantities and their parameters."""
    del query
    return PageDocument(
        items=[
            ModelDocument(
                id=name,
                unit=model.unit,
                description=model.description,
                parameters=[
                    ParameterDocument(
                        name=each.name,
                        unit=each.unit,
                        required=each.required,
                        usual=interval(*each.usual or (None, None)),
                    )
                    for each in model.parameters
                ],
            )
            for name, model in MODELS.items()
        ],
        next=None,
    )
