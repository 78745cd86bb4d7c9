"""The firmware's measurement of whole arrays of codes, for datasets and tests."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Interval
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.data_sheet import data_sheet

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin_sensor_node.kinds.converter import Codes
    from eskin_sensor_node.kinds.settings import Companion, TaxelSection


class Inversion:
    """What the control unit makes of ADC codes, by its own arithmetic, compiled.

    Args:
        taxel: Its settings; never its true parts.
        companions: What it reads along, by the names of its inputs.
    """

    def __init__(
        self, taxel: TaxelSection, companions: Mapping[str, Companion] | None = None
    ) -> None:
        sheet = data_sheet(taxel, companions)
        self._taxel = taxel.firmware(sheet, compiled_inversion())

    def measure(self, codes: Mapping[str, Codes]) -> dict[str, Interval]:
        """Quantity to intervals, in the shape of the codes."""
        given = [array("q", codes[name].tobytes()) for name in self._taxel.inputs]
        n, shape = len(given[0]), codes[self._taxel.inputs[0]].shape
        bounds = [array("d", bytes(8 * n)) for _ in range(2 * len(self._taxel.quantities))]
        self._taxel.measure(given, n, bounds)
        self._taxel.separate(n, bounds, ())
        return {
            quantity: Interval(np.array(bounds[2 * k]), np.array(bounds[2 * k + 1])).reshape(*shape)
            for k, (quantity, _) in enumerate(self._taxel.quantities)
        }
