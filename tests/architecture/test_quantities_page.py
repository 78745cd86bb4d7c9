"""Every channel that a taxel can have stands in the table of quantities, with its unit."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from eskin_sensor_node.kinds.registry import KINDS

PAGE = Path(__file__).parents[2] / "docs" / "quantities.md"
ROWS = re.findall(r"^\| `(\w+)` \| `(.+?)` \|", PAGE.read_text(), re.MULTILINE)


@pytest.mark.parametrize("kind", KINDS)
def test_channels_are_listed(kind: str) -> None:
    quantities = KINDS[kind].settings.firmware.quantities
    assert quantities
    assert set(quantities) <= set(ROWS)


def test_no_row_is_of_a_channel_that_does_not_exist() -> None:
    known = {pair for kind in KINDS.values() for pair in kind.settings.firmware.quantities}
    assert set(ROWS) == known
