"""The examples of the page about contacts run, and print what they say."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pytest

PAGE = Path(__file__).parents[4] / "docs" / "contacts.md"


def test_examples_print_what_they_say(capsys: pytest.CaptureFixture[str]) -> None:
    code = "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL))
    names: dict[str, Any] = {}
    exec(compile(code, str(PAGE), "exec"), names)  # noqa: S102 - our own documentation
    printed = capsys.readouterr().out
    assert "Contacts(1 cores in 2 regions, 1 to 2 contacts)" in printed
    assert printed.splitlines()[-1] == "0 (0, 40100000) (100000000, 140100000)"
    assert len(names["found"].regions.possible) == 1
