"""The examples of the page about wear run, and print what they say."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pytest

PAGE = Path(__file__).parents[4] / "docs" / "wear.md"


def test_examples_print_what_they_say(capsys: pytest.CaptureFixture[str]) -> None:
    code = "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL))
    names: dict[str, Any] = {}
    exec(compile(code, str(PAGE), "exec"), names)  # noqa: S102 - our own documentation
    printed = capsys.readouterr().out.splitlines()
    assert printed == [
        "True",
        "61 73",
        "[126, inf]",
        "[199, 247]",
        "[9.8e+4, 1.01e+5]",
        "True",
    ]
    said = re.findall(r"# (?:the days: )?(True|\d+ \d+|\[[^]]*\])", code)
    assert said == printed
