"""What a dataset is made of: scenario, data sheets, seeds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar

import numpy as np
from pydantic import ValidationError

from eskin.errors import ScenarioError
from sensor_node.dataset.columns import COIL, PAD, SURROUNDINGS
from sensor_node.firmware.calibration import EPSILON_0
from sensor_node.scenario import read_scenario
from sensor_node.scenario.file import refusal
from sensor_node.taxels import CoilSection, PadSection

if TYPE_CHECKING:
    from eskin.interval import Floats
    from sensor_node.dataset.columns import Quantity
    from sensor_node.scenario import Script

Sheet = TypeVar("Sheet", PadSection, CoilSection)

_FILL: Final = 0.9
"""Share of a taxel's cell that its plates take."""
_REST_HERTZ: Final = 1e6
"""At which a pad's oscillator runs at rest, if no data sheet says otherwise."""
_HEADROOM: Final = 1.25
_LEAST_PRESSURE: Final = 1e3
_FIXED: Final = ("id", "kind", "scenario", "place", "sampling_Hz")
_OF_NODES: Final = ("thermometer", "hygrometer")
"""A dataset has sensors of the air of its own."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A dataset before it is made.

    Attributes:
        scenario: The scenario's file, or its packaged name.
        script: What it says.
        train: Seeds of the runs to learn from.
        test: Seeds of the runs to test with.
        rate: Samples in a second.
        pads: One data sheet a taxel of the skin.
        coils: Likewise; none where no metal comes near.
    """

    scenario: str
    script: Script
    train: tuple[int, ...]
    test: tuple[int, ...]
    rate: float
    pads: tuple[PadSection, ...]
    coils: tuple[CoilSection, ...]

    @classmethod
    def of(cls, scenario: str, *, seeds: range, test: int, rate: float) -> Self:
        """Read a scenario and lay out the runs.

        Args:
            scenario: Its file, or its packaged name.
            seeds: One for each run.
            test: How many of them, the last ones, are for testing.
            rate: Samples in a second.

        Raises:
            ScenarioError: It cannot be read, or a data sheet in it cannot be used.
        """
        script = read_scenario(scenario)
        border = len(seeds) - test
        metal = script.coil or any(event.kind == "approach" for event in script.event)
        return cls(
            scenario=scenario,
            script=script,
            train=tuple(seeds[:border]),
            test=tuple(seeds[border:]),
            rate=rate,
            pads=_pads(scenario, script, rate),
            coils=_coils(scenario, script, rate) if metal else (),
        )

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What has columns."""
        return PAD + (COIL if self.coils else ()) + SURROUNDINGS

    @property
    def seconds(self) -> Floats:
        """When samples are taken."""
        return np.asarray(np.arange(math.floor(self.script.duration_s * self.rate)) / self.rate)

    @property
    def coverage(self) -> float:
        """Probability that a single interval holds the truth, at least."""
        taxels: list[PadSection | CoilSection] = [*self.pads, *self.coils]
        return min(taxel.coverage for taxel in taxels)


def _pads(scenario: str, script: Script, rate: float) -> tuple[PadSection, ...]:
    skin = script.skin.build()
    given = {
        "plate_area_m2": _rounded(_FILL * skin.cell_area),
        "pressure_max_Pa": max(_LEAST_PRESSURE, _rounded(_HEADROOM * script.peak_pressure)),
        "crosstalk": script.skin.crosstalk,
        **_air(script),
        "reference_Hz": _HEADROOM * _REST_HERTZ,
        "noise": {"kind": "uniform", "bound": 1e-7},
    }
    sheet = _sheet(PadSection, "pad", given | script.pad, scenario=scenario, rate=rate)
    if "resistance_ohm" not in script.pad:
        plates = sheet.relative_permittivity * sheet.plate_area_m2 / sheet.plate_distance_m
        resistance = _rounded(1.0 / (2.0 * math.pi * _REST_HERTZ * EPSILON_0 * plates))
        sheet = sheet.model_copy(update={"resistance_ohm": resistance})
    return tuple(sheet.model_copy(update={"id": name, "place": name}) for name in skin.names)


def _air(script: Script) -> dict[str, float]:
    """What a data sheet states of the air: all that the scenario has."""
    temperatures = [value for _, value in script.ambient.temperature_Cel]
    humidities = [value for _, value in script.ambient.humidity_percent]
    return {
        "temperature_min_Cel": min(temperatures),
        "temperature_max_Cel": max(temperatures),
        "humidity_min_percent": min(humidities),
        "humidity_max_percent": max(humidities),
    }


def _coils(scenario: str, script: Script, rate: float) -> tuple[CoilSection, ...]:
    given = {"adc_min_V": 0.6, "adc_max_V": 0.95, "noise": {"kind": "uniform", "bound": 2e-5}}
    sheet = _sheet(CoilSection, "coil", given | script.coil, scenario=scenario, rate=rate)
    names = script.skin.build().names
    return tuple(sheet.model_copy(update={"id": name, "place": name}) for name in names)


def _sheet(
    model: type[Sheet], kind: str, table: dict[str, Any], *, scenario: str, rate: float
) -> Sheet:
    """The data sheet of the skin's first taxel, as a scenario's table has it."""
    for key in (*_FIXED, *_OF_NODES):
        if key in table:
            raise ScenarioError(scenario, f"{kind}.{key}", "the dataset itself sets it")
    first = read_scenario(scenario).skin.build().names[0]
    fixed = dict(zip(_FIXED, (first, kind, scenario, first, rate), strict=True))
    try:
        return model.model_validate(table | fixed)
    except ValidationError as error:
        raise refusal(scenario, error, within=kind) from error


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")
