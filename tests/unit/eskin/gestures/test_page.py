"""The example of the page about gestures runs, and prints what it says; its constants are right."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eskin.gestures import Templates

if TYPE_CHECKING:
    import pytest

PAGE = Path(__file__).parents[4] / "docs" / "gestures.md"
UNITS = {"ms": 1_000_000, "mm": 1e-3, "mm/s": 1e-3, "": 1.0}


def test_example_prints_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    code = "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL))
    names: dict[str, Any] = {}
    exec(compile(code, str(PAGE), "exec"), names)  # noqa: S102 - our own documentation
    assert capsys.readouterr().out.startswith("swipe CERTAIN (")
    assert len(names["found"]) == 1
    low, high = names["found"][0].direction
    assert low <= 0.0 <= high


def test_constants_are_those_of_the_page() -> None:
    said = re.findall(r"`(\w+)` = ([\d.]+) ?(ms|mm/s|mm|)", PAGE.read_text())
    templates = Templates()
    assert {name for name, _, _ in said} == set(Templates.__dataclass_fields__)
    for name, number, unit in said:
        assert abs(getattr(templates, name) - float(number) * UNITS[unit]) < 1e-12, name
