"""Which models channels may be compared with."""

from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field
from starlette.responses import Response

from eskin_cloud.api.dependencies import Reader
from eskin_cloud.api.problems import REFUSALS
from eskin_cloud.api.responses import as_json
from eskin_cloud.query.models import MODELS, Model
from eskin_cloud.schemas.documents import IntervalDocument, NoQuery, PageDocument
from eskin_cloud.schemas.shapes import Json, page

router = APIRouter(tags=["series"])


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


@router.get("/models", response_model=PageDocument[ModelDocument], responses=REFUSALS)
def get_models(_: Reader, query: Annotated[NoQuery, Query()]) -> Response:
    """List the models' quantities and their parameters."""
    del query
    return as_json(page([_shape(name, model) for name, model in MODELS.items()], None))


def _shape(name: str, model: Model) -> Json:
    parameters = [
        {
            "name": each.name,
            "unit": each.unit,
            "required": each.required,
            "usual": None
            if each.usual is None
            else dict(zip(("lo", "hi"), each.usual, strict=True)),
        }
        for each in model.parameters
    ]
    return {
        "id": name,
        "unit": model.unit,
        "description": model.description,
        "parameters": parameters,
    }
