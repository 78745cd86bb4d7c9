"""The OpenAPI description, with a summary and an example of each operation."""

from __future__ import annotations

from functools import partial
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

import orjson
from fastapi import FastAPI

if TYPE_CHECKING:
    from collections.abc import Iterator

_EXAMPLES: Final = "examples.json"


def describe_all(app: FastAPI) -> None:
    """Have an application's description hold a summary and an example of each operation."""
    app.openapi = partial(_describe, app)  # type: ignore[method-assign]  # as FastAPI documents


def _describe(app: FastAPI) -> dict[str, Any]:
    if app.openapi_schema is not None:
        return app.openapi_schema
    described = FastAPI.openapi(app)
    examples = orjson.loads((files(__package__) / _EXAMPLES).read_bytes())
    for name, operation in operations(described):
        # A route's docstring begins with its summary.
        text = operation.pop("description", "")
        operation["summary"], _, rest = text.partition("\n\n")
        if rest:
            operation["description"] = rest
        for parameter in operation.get("parameters", []):
            if (example := examples["parameters"].get(parameter["name"])) is not None:
                parameter["example"] = example
        example = examples["operations"].get(name, {})
        _add(operation.get("requestBody", {}), example.get("request"))
        for status, answer in operation["responses"].items():
            if status.startswith("2"):
                _add(answer, example.get("response"))
    return described


def operations(described: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each operation of a description, by method and path."""
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            yield f"{method.upper()} {path}", operation


def _add(body: dict[str, Any], example: object) -> None:
    """Add an example of a body in the media type that is offered first."""
    for content in list(body.get("content", {}).values())[:1]:
        if example is not None:
            content["example"] = example
