"""What a dataset is made of: scenario, data sheets, seeds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar

import numpy as np
from pydantic import ValidationError

from eskin.constants import VACUUM_PERMITTIVITY
from eskin.errors import ScenarioError
from eskin.union_bound import union_coverage
from eskin_sensor_node.kinds.bioelectric import BioelectricSection
from eskin_sensor_node.kinds.coil import CoilSection
from eskin_sensor_node.kinds.hygrometer import HygrometerSection
from eskin_sensor_node.kinds.pad import PadSection
from eskin_sensor_node.kinds.registry import KINDS
from eskin_sensor_node.kinds.thermometer import ThermometerSection
from eskin_sensor_node.tools.dataset.columns import COIL, PAD, SURROUNDINGS
from eskin_sensor_node.world.scenario import read_scenario
from eskin_sensor_node.world.scenario.file import refusal
from eskin_sensor_node.world.scenario.fit import Staged

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.tools.dataset.columns import DatasetQuantity
    from eskin_sensor_node.world.scenario import Script

Sheet = TypeVar(
    "Sheet", PadSection, CoilSection, ThermometerSection, HygrometerSection, BioelectricSection
)

_FILL: Final = 0.9
"""Share of a taxel's cell that its plates take."""
_REST_HERTZ: Final = 1e6
"""At which a pad's oscillator runs at rest, unless a data sheet has another value."""
_HEADROOM: Final = 1.25
_LEAST_PRESSURE: Final = 1e3
_MOST_GAIN: Final = 500.0
"""Of an electrode's amplifier, where the body's voltage allows it."""
_FIXED: Final = ("id", "kind", "scenario", "place", "sampling_Hz")
_OF_NODES: Final = ("thermometer", "hygrometer")
"""A pad of a dataset reads the dataset's own sensors of the air."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A dataset before it is made.

    Attributes:
        scenario: The scenario's file, or its packaged name.
        script: Its script.
        train: Seeds of the runs to learn from.
        test: Seeds of the runs to test with.
        rate: Samples in a second.
        pads: One data sheet a taxel of the skin.
        coils: Likewise; none where no metal comes near.
        thermometer: Which all taxels read along.
        hygrometer: Likewise.
        electrode: What reads the body's voltage.
    """

    scenario: str
    script: Script
    train: tuple[int, ...]
    test: tuple[int, ...]
    rate: float
    pads: tuple[PadSection, ...]
    coils: tuple[CoilSection, ...]
    thermometer: ThermometerSection
    hygrometer: HygrometerSection
    electrode: BioelectricSection

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
            thermometer=_thermometer(scenario, script, rate),
            hygrometer=_hygrometer(scenario, script, rate),
            electrode=_electrode(scenario, script, rate),
        )

    @property
    def quantities(self) -> tuple[DatasetQuantity, ...]:
        """What has columns."""
        return PAD + (COIL if self.coils else ()) + SURROUNDINGS

    @property
    def seconds(self) -> Floats:
        """When samples are taken."""
        return np.asarray(np.arange(math.floor(self.script.duration_s * self.rate)) / self.rate)

    @property
    def coverage(self) -> float:
        """Probability that a single interval holds the truth, at least."""
        # A pad's contacts follow from the air, too.
        air = (self.thermometer, self.hygrometer)
        pads = [union_coverage(*(each.coverage for each in (pad, *air))) for pad in self.pads]
        rest: list[TaxelSection] = [*self.coils, self.electrode]
        return min(pads + [taxel.coverage for taxel in rest])


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
    sheet = _sheet(PadSection, given | script.pad, scenario=scenario, rate=rate)
    if "resistance_ohm" not in script.pad:
        plates = sheet.relative_permittivity * sheet.plate_area_m2 / sheet.plate_distance_m
        rest = float(VACUUM_PERMITTIVITY.mid) * plates
        resistance = _rounded(1.0 / (2.0 * math.pi * _REST_HERTZ * rest))
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
    sheet = _sheet(CoilSection, given | script.coil, scenario=scenario, rate=rate)
    names = script.skin.build().names
    return tuple(sheet.model_copy(update={"id": name, "place": name}) for name in names)


def _thermometer(scenario: str, script: Script, rate: float) -> ThermometerSection:
    given = {"noise": {"kind": "uniform", "bound": 1e-5}} | script.thermometer
    return _sheet(ThermometerSection, given, scenario=scenario, rate=rate)


def _hygrometer(scenario: str, script: Script, rate: float) -> HygrometerSection:
    given = {"noise": {"kind": "uniform", "bound": 1e-7}} | script.hygrometer
    return _sheet(HygrometerSection, given, scenario=scenario, rate=rate)


def _electrode(scenario: str, script: Script, rate: float) -> BioelectricSection:
    most = script.bioelectric.amplitude_V
    gain = min(_MOST_GAIN, _rounded(1.0 / most)) if most > 0.0 else _MOST_GAIN
    given = {"electrode_gain_V_per_V": gain, "noise": {"kind": "uniform", "bound": 1e-4}}
    return _sheet(
        BioelectricSection,
        given | script.electrode,
        scenario=scenario,
        rate=rate,
        name="electrode",
    )


def _sheet(
    model: type[Sheet],
    table: dict[str, Any],
    *,
    scenario: str,
    rate: float,
    name: str = "",
) -> Sheet:
    """A data sheet as a scenario's table has it: that of the skin's first taxel, or of a sensor."""
    kind = next(each.name for each in KINDS.values() if each.settings is model)
    for key in (*_FIXED, *_OF_NODES):
        if key in table:
            raise ScenarioError(scenario, f"{name or kind}.{key}", "the dataset itself sets it")
    first = read_scenario(scenario).skin.build().names[0]
    fixed = dict(zip(_FIXED, (first, kind, scenario, first, rate), strict=True))
    if not issubclass(model, Staged):
        del fixed["place"]
    try:
        return model.model_validate(table | fixed)
    except ValidationError as error:
        raise refusal(scenario, error, within=name or kind) from error


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")
