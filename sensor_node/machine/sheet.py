"""The data sheet that the firmware is given: numbers by name, and nothing true."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from sensor_node.taxels import AnyTaxel

_UNIT: Final = re.compile(r"_(per_m|ohm|m2|m)$")
"""Of names in which the unit is a part of the Python name, too."""


def data_sheet(taxel: AnyTaxel) -> dict[str, float]:
    """All numbers of a taxel's settings, in SI units; ``reach``: how far its noise may reach."""
    numbers = {
        _UNIT.sub("", name): float(value) for name, value in taxel if isinstance(value, int | float)
    }
    return numbers | {"adc_min": taxel.adc_min, "reach": taxel.noise.reach}
