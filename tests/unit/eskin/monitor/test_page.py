"""The examples of the page about monitors run, and print what they say; its formulas parse."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eskin.monitor import check, parse

if TYPE_CHECKING:
    import pytest

PAGE = Path(__file__).parents[4] / "docs" / "monitors.md"


def test_examples_print_what_they_say(capsys: pytest.CaptureFixture[str]) -> None:
    code = "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL))
    names: dict[str, Any] = {}
    exec(compile(code, str(PAGE), "exec"), names)  # noqa: S102 - our own documentation
    printed = capsys.readouterr().out.splitlines()
    assert printed[:3] == ["CERTAIN", "POSSIBLE Because.PENDING", "True"]
    assert "20000000 80000000 CERTAIN" in printed


def test_ten_formulas_pass_the_checks() -> None:
    table = PAGE.read_text().partition("## Ten formulas")[2].partition("## Why")[0]
    formulas = re.findall(r"^\| `([^`]*)`", table, re.MULTILINE)
    assert len(formulas) == 10
    units = {"pressure": "Pa", "velocity": "m/s", "force": "N", "distance": "m", "current": "A"}
    for text in formulas:
        formula = parse(text)
        assert parse(str(formula)) == formula
        found = {name: units.get(name.partition(".")[2], "Cel") for name in formula.channels}
        check(formula, found, bounded=True)
