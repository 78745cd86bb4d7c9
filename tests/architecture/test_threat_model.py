"""Each threat names a test, and that test is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "threat-model.md").read_text()
NAMED = re.findall(r"^\| [^|]+ \| `([^`]+)` \|$", PAGE, re.MULTILINE)


@pytest.mark.parametrize("named", NAMED)
def test_test_of_a_threat_is_there(named: str) -> None:
    file, name = named.split("::")
    tree = ast.parse((ROOT / "tests" / file).read_text())
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    assert name in {node.name for node in tree.body if isinstance(node, functions)}


def test_each_row_of_the_threat_model_names_a_test() -> None:
    table = PAGE.split("## Threats and their tests")[1]
    rows = [line for line in table.splitlines() if line.startswith("| ") and "threat |" not in line]
    assert len(rows) == len(NAMED) == len(set(NAMED)) > 40
    for word in ("Spoofing", "Tampering", "Repudiation", "disclosure", "Denial", "Elevation"):
        assert word in table
