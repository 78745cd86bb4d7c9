"""Every setting is documented, with its default, and the page is current."""

from __future__ import annotations

from pathlib import Path

import pytest

from eskin.cli.settings import PROCESSES, page
from eskin.runtime.settings import table

PAGE = Path(__file__).parents[2] / "docs" / "settings.md"


@pytest.mark.parametrize("process", PROCESSES)
def test_every_setting_has_its_help(process: str) -> None:
    rows = list(table(PROCESSES[process]))
    assert rows
    assert [row.name for row in rows if not row.help] == []


def test_page_of_settings_is_current() -> None:
    assert PAGE.read_text() == page(), "python -m eskin.cli.settings > docs/settings.md"
