"""The keys of a table in a TOML file, as Markdown."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pydantic import BaseModel


def keys_table(heading: str, model: type[BaseModel]) -> Iterator[str]:
    """Lines of Markdown: a table of TOML, and its keys.

    Args:
        heading: Such as ``[[taxel]]``.
        model: Its keys.
    """
    yield f"### {heading}\n\n{_oneline(model)}\n"
    yield "| key | default | allowed | what it is |\n|---|---|---|---|"
    for key, field in model.model_json_schema()["properties"].items():
        if "const" in field:  # the kind, which the heading says
            continue
        default = _default(field)
        yield f"| `{key}` | {default} | {_allowed(field)} | {field.get('description', '')} |"
    yield ""


def _default(field: dict[str, Any]) -> str:
    if "default" not in field:
        return "*must be given*"
    return "*none*" if field["default"] is None else f"`{json.dumps(field['default'])}`"


def _oneline(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split())


def _allowed(field: dict[str, Any]) -> str:
    """What a JSON schema (draft 2020-12) says of one key."""
    alternatives = field.get("anyOf", [field])
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    limits = [
        f"{sign} {option[word]:g}"
        for option in alternatives
        for word, sign in signs.items()
        if word in option
    ]
    if "pattern" in field:
        limits.append(f"`{field['pattern']}`")
    return ", ".join(limits)
