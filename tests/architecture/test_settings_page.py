"""Every setting is documented, with its default, and the page is current."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "settings.md"
SETTING_WITHOUT_HELP = re.compile(r"^\| `\w+\.\w+` \|[^|]*\|\s*\|$", re.MULTILINE)


def test_every_setting_has_its_help() -> None:
    assert SETTING_WITHOUT_HELP.findall(PAGE.read_text()) == []


def test_page_of_settings_is_current() -> None:
    command = [sys.executable, "-m", "docs.tools.settings"]
    page = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    assert PAGE.read_text() == page, "python -m docs.tools.settings > docs/settings.md"
