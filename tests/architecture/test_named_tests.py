"""A test that a page names is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
NAMED = re.compile(r"`(?:tests/)?((?:\w+/)*test_\w+\.py)(?:::(\w+))?`")
FOUND = sorted(
    {
        (str(page.relative_to(ROOT)), file, name)
        for page in PAGES
        for file, name in NAMED.findall(page.read_text())
    }
)


@pytest.mark.parametrize(("page", "file", "name"), FOUND)
def test_test_that_a_page_names_is_there(page: str, file: str, name: str) -> None:
    tree = ast.parse((ROOT / "tests" / file).read_text())
    functions = {
        node.name
        for node in tree.body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.name.startswith("test_")
    }
    assert functions, f"{page}: {file} tests nothing by functions"
    assert not name or name in functions


def test_pages_name_tests() -> None:
    assert {page for page, _, _ in FOUND} >= {"docs/threat-model.md", "docs/delivery.md"}
