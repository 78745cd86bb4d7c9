"""Print the cloud's OpenAPI description, or TypeScript types of its answers, without a server.

``python -m docs.tools.openapi`` prints ``openapi.json``; with ``--typescript`` it prints
``cloud/dashboard/src/api/schema.ts``.
"""

from __future__ import annotations

import argparse
import json
import sys
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final, cast

from eskin_cloud.app import people_application
from eskin_cloud.settings import LimitsSection

if TYPE_CHECKING:
    from eskin_cloud.app_state import AppState

_HEADER: Final = "/* Written by `python -m docs.tools.openapi --typescript`: do not edit. */\n"
_SCALARS: Final = {
    "string": "string",
    "integer": "number",
    "number": "number",
    "boolean": "boolean",
    "null": "null",
}


def describe() -> dict[str, Any]:
    """The OpenAPI 3.1 description of the REST API."""
    settings = SimpleNamespace(limits=LimitsSection())
    state = SimpleNamespace(secure=True, settings=settings, metrics=SimpleNamespace(requests=None))
    return people_application(cast("AppState", state)).openapi()


def write_typescript(description: dict[str, Any]) -> str:
    """One interface for each object that the API answers with; lists are `Page` in TypeScript."""
    schemas = description["components"]["schemas"]
    found: set[str] = set()
    for item in description["paths"].values():
        for operation in item.values():
            for status, answer in operation["responses"].items():
                if status.startswith("2"):
                    _collect(answer, schemas, found)
    names = sorted(name for name in found if not name.startswith("PageDocument_"))
    return _HEADER + "".join(f"\n{_interface(name, schemas[name])}" for name in names)


def _collect(value: Any, schemas: dict[str, Any], found: set[str]) -> None:
    """Add the names of all schemas that a part of the description refers to."""
    if isinstance(value, list):
        for each in value:
            _collect(each, schemas, found)
    elif isinstance(value, dict):
        if (name := _name(value)) and name not in found:
            found.add(name)
            _collect(schemas[name], schemas, found)
        _collect(list(value.values()), schemas, found)


def _name(schema: dict[str, Any]) -> str | None:
    reference = schema.get("$ref")
    return reference.rsplit("/", 1)[1] if isinstance(reference, str) else None


def _interface(name: str, schema: dict[str, Any]) -> str:
    required = schema.get("required", [])
    fields = "".join(
        f"  readonly {field}{'' if field in required else '?'}: {_type(each)};\n"
        for field, each in schema["properties"].items()
    )
    return f"export interface {name} {{\n{fields}}}\n"


def _type(schema: dict[str, Any]) -> str:
    if name := _name(schema):
        return name
    if "anyOf" in schema:
        return " | ".join(map(_type, schema["anyOf"]))
    if constants := schema.get("enum", [schema["const"]] if "const" in schema else []):
        return " | ".join(map(json.dumps, constants))
    return _container(schema) or _SCALARS[schema["type"]]


def _container(schema: dict[str, Any]) -> str | None:
    if "prefixItems" in schema:
        return f"readonly [{', '.join(map(_type, schema['prefixItems']))}]"
    if schema["type"] == "array":
        item = _type(schema["items"])
        return f"readonly ({item})[]" if " " in item else f"readonly {item}[]"
    if schema["type"] == "object":
        return f"Readonly<Record<string, {_type(schema['additionalProperties'])}>>"
    return None


def main() -> None:
    """Print what the arguments ask for."""
    parser = argparse.ArgumentParser(description="Print the cloud's OpenAPI description.")
    parser.add_argument("--typescript", action="store_true", help="types of answers instead")
    typescript = parser.parse_args().typescript
    found = describe()
    sys.stdout.write(write_typescript(found) if typescript else json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
