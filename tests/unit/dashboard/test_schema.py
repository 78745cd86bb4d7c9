"""The dashboard's types of REST answers."""

from __future__ import annotations

from docs.tools.openapi import describe, write_typescript
from tests.unit.dashboard.browsing import SOURCE


def test_types_are_generated_from_the_current_description() -> None:
    committed = (SOURCE / "api" / "schema.ts").read_text()
    command = "python -m docs.tools.openapi --typescript > cloud/dashboard/src/api/schema.ts"
    assert committed == write_typescript(describe()), f"run: {command}"
