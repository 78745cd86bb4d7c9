"""Integer thresholds decide as the inversion does, on every code of the converter."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
import pytest
from eskin_sensor_node.firmware.reflex import code_ranges
from eskin_sensor_node.kinds.registry import KINDS
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.data_sheet import data_sheet

from tests.unit.sensor_node.designs import KINDS as PACKAGED
from tests.unit.sensor_node.designs import taxel

MONOTONE = [
    (kind, quantity) for kind in PACKAGED for quantity in KINDS[kind].settings.firmware.monotone
]


@pytest.mark.parametrize(("kind", "quantity"), MONOTONE)
def test_thresholds_decide_as_the_inversion_on_every_code(kind: str, quantity: str) -> None:
    changes = {"thermometer": None, "hygrometer": None} if kind == "pad" else {}
    section = taxel(kind, **changes)
    calibrated = section.firmware(data_sheet(section, {}), compiled_inversion())
    place = [name for name, _ in calibrated.quantities].index(quantity)
    for gain, trim in ((1.0, 0), (0.7, 0)):
        calibrated.adjust(gain, trim)
        codes = np.arange(calibrated.last + 1)
        count = len(codes)
        bounds = [array("d", bytes(8 * count)) for _ in range(2 * len(calibrated.quantities))]
        inputs: list[Any] = [codes, *(np.zeros(count, np.int64) for _ in calibrated.inputs[1:])]
        calibrated.measure(inputs, count, bounds)
        lo, hi = (np.array(bounds[2 * place + side]) for side in (0, 1))
        values = np.concatenate((lo, hi))
        values = np.quantile(values[np.isfinite(values)], (0.0, 0.05, 0.3, 0.5, 0.8, 1.0))
        for value in [*values, 2 * values[-1], -1e300]:
            for upward in (True, False):
                certain, possible = code_ranges(
                    calibrated, 0, place, upward=upward, value=float(value)
                )
                near, far = (lo >= value, hi >= value) if upward else (hi <= value, lo <= value)
                assert np.array_equal((certain[0] <= codes) & (codes <= certain[1]), near)
                assert np.array_equal((possible[0] <= codes) & (codes <= possible[1]), far)
