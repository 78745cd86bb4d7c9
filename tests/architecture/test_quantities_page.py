"""Every channel that a taxel can have stands in the table of quantities, with its unit."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import pytest
from eskin_sensor_node.firmware.taxel import CHAINS
from eskin_sensor_node.taxels import AnyTaxel

if TYPE_CHECKING:
    from eskin_sensor_node.taxels import TaxelSection

PAGE = Path(__file__).parents[2] / "docs" / "quantities.md"
ROWS = re.findall(r"^\| `(\w+)` \| `(.+?)` \|", PAGE.read_text(), re.MULTILINE)


@pytest.mark.parametrize("model", get_args(AnyTaxel))
def test_channels_are_listed_and_the_firmware_has_the_same(model: type[TaxelSection]) -> None:
    assert model.units
    assert set(model.units.items()) <= set(ROWS)
    assert tuple(model.units.items()) == CHAINS[model.chain].quantities


def test_no_row_is_of_a_channel_that_does_not_exist() -> None:
    known = {pair for model in get_args(AnyTaxel) for pair in model.units.items()}
    assert set(ROWS) == known
