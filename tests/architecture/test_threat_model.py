"""Each threat names a test; `test_pages` checks that it exists."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "threat-model.md").read_text()
NAMED = re.findall(r"^\| [^|]+ \| `([^`]+::[^`]+)` \|$", PAGE, re.MULTILINE)


def test_each_row_of_the_threat_model_names_a_test() -> None:
    table = PAGE.split("## Threats and their tests")[1]
    rows = [line for line in table.splitlines() if line.startswith("| ") and "threat |" not in line]
    assert len(rows) == len(NAMED) == len(set(NAMED)) > 40
    for word in ("Spoofing", "Tampering", "Repudiation", "disclosure", "Denial", "Elevation"):
        assert word in table
