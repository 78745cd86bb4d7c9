"""A plate in a vacuum is enclosed, with the permittivity that nature has.

The oracle is scipy's table of CODATA 2022; no constant of ours takes part in the truth.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.firmware.calibration import EPSILON_0 as EPSILON_0_OF_FIRMWARE
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.kinds.parameters import TRUE_VACUUM_PERMITTIVITY
from eskin_sensor_node.kinds.registry import build_frontend, build_world
from eskin_sensor_node.machine.inversion import Inversion
from scipy import constants as codata

from eskin.constants import VACUUM_PERMITTIVITY
from eskin.interval import Interval
from tests.unit.sensor_node.designs import taxel

if TYPE_CHECKING:
    from eskin_sensor_node.kinds.settings import TaxelSection

EPSILON_0, _, _UNCERTAINTY = codata.physical_constants["vacuum electric permittivity"]
NATURE = [EPSILON_0 + k * _UNCERTAINTY for k in (-2.0, 0.0, 2.0)]
PARTS = {
    "touch": (
        "resistance",
        "reference",
        "transconductance",
        "plate_distance",
        "supply",
        "area",
        "relative_permittivity",
    ),
    "pad": (
        *("resistance", "reference", "transconductance", "plate_area", "plate_distance"),
        *("elasticity", "relative_permittivity"),
    ),
}


def vacuum(kind: str) -> TaxelSection:
    """A taxel of which everything is known; its converter is far finer than 21 parts in 1e6."""
    exact: dict[str, Any] = {f"{part}_tolerance": 0.0 for part in PARTS[kind]}
    exact |= {"adc_gain_error": 0.0, "adc_offset_error": 0.0, "adc_nonlinearity": 0.5}
    if kind == "pad":
        exact |= {"permittivity_per_K": 0.0, "permittivity_per_percent": 0.0, "place": "t05"}
        # A third of its own permittivity, which the data sheet's resistance is for.
        pad: Any = taxel("pad")
        exact["resistance_ohm"] = 3.0 * pad.resistance_ohm
    return taxel(
        kind,
        **exact,
        relative_permittivity=1.0,
        adc_bits=24,
        noise={"kind": "uniform", "bound": 0.0},
    )


@pytest.mark.parametrize("epsilon_0", NATURE)
def test_area_of_a_plate_in_a_vacuum_is_enclosed(epsilon_0: float) -> None:
    design: Any = vacuum("touch")
    area = np.linspace(2e-5, 1e-4, 200)
    capacitance = epsilon_0 * area / design.plate_distance_m
    random = ColumnGenerator(1, 0)
    frontend = build_frontend(design, random)
    random.begin(1, np.arange(200))
    codes = frontend.digitise({"capacitance": capacitance}, random).codes
    stated = Inversion(design).measure(codes)
    assert np.all(stated["area"].contains(area))
    assert np.max(stated["area"].wid / area) < 5e-6  # the paper's 8.854e-12 is 21e-6 away


@pytest.mark.parametrize("epsilon_0", NATURE)
def test_distance_of_plates_in_a_vacuum_is_enclosed(epsilon_0: float) -> None:
    design: Any = vacuum("pad")
    distance = np.linspace(0.5e-3, 1e-3, 200)
    capacitance = epsilon_0 * design.plate_area_m2 / distance
    random = ColumnGenerator(1, 0)
    frontend = build_frontend(design, random)
    random.begin(1, np.arange(200))
    codes = frontend.digitise({"capacitance": capacitance}, random).codes
    stated = Inversion(design).measure(codes)
    assert np.all(stated["plate_distance"].contains(distance))
    assert np.max(stated["plate_distance"].wid / distance) < 5e-6


@pytest.mark.parametrize("kind", ["touch", "pad"])
def test_emulated_plates_stand_in_nature_s_vacuum(kind: str) -> None:
    design: Any = vacuum(kind)
    random = ColumnGenerator(2, 0)
    world = build_world(design, random)
    random.begin(1, np.arange(100))
    true = world.signals(np.linspace(0.0, 5.0, 100), random).truth
    if kind == "touch":
        found = true["capacitance"] * design.plate_distance_m / true["area"]
    else:
        # What neighbours hand on is in the plates' mean distance, too.
        found = true["capacitance"] * true["plate_distance"] / design.plate_area_m2
    assert np.all(np.abs(found / EPSILON_0 - 1.0) < 20.0 * _UNCERTAINTY / EPSILON_0)


def test_firmware_has_the_bounds_that_models_have() -> None:
    # It imports nothing of eskin, so it has its own.
    firmware = Interval(*EPSILON_0_OF_FIRMWARE)
    assert VACUUM_PERMITTIVITY.subset(firmware)
    assert firmware.wid < 1.001 * VACUUM_PERMITTIVITY.wid
    assert VACUUM_PERMITTIVITY.contains(TRUE_VACUUM_PERMITTIVITY)
