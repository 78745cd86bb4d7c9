"""Quantities of the ³S models that formulas may use as predictions, with their parameters."""

from __future__ import annotations

from dataclasses import dataclass
from inspect import Parameter, signature
from typing import TYPE_CHECKING, Any, Final

from eskin import models
from eskin.errors import MonitorError, shown
from eskin.interval import as_interval

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from eskin.interval import Interval


def constant(_time: Interval, *, value: Interval) -> Interval:
    """A constant band."""
    return value


@dataclass(frozen=True, slots=True)
class ModelParameter:
    """A parameter of a model.

    Attributes:
        name: Name of its function's keyword.
        unit: UCUM code; ``None`` for the channel's unit.
        required: Whether it must be given.
        usual: Default bounds, or the paper's value with its tolerance; ``None`` without any.
    """

    name: str
    unit: str | None
    required: bool
    usual: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class Model:
    """A quantity over time.

    Attributes:
        name: A function of `eskin.models`, or `constant`.
        part: Attribute of its result; ``None`` for the result itself.
        unit: UCUM code; ``None`` for the parameters' unit.
    """

    name: str
    part: str | None
    unit: str | None

    @property
    def function(self) -> Callable[..., Any]:
        """The function of time and parameters."""
        return constant if self.name == "constant" else getattr(models, self.name)

    @property
    def description(self) -> str:
        """A description of one line."""
        return (self.function.__doc__ or "").partition("\n")[0].replace("``", "")

    @property
    def parameters(self) -> list[ModelParameter]:
        """Its parameters, in order."""
        usual = DEFAULTS.get(self.name, {})
        return [
            ModelParameter(
                name,
                UNITS[name],
                required=default is Parameter.empty,
                usual=usual.get(name) if default is Parameter.empty else _ends(default),
            )
            for name, default in self._keywords().items()
        ]

    def require_parameters(self, given: Sequence[str]) -> None:
        """Check the names of given parameters.

        Raises:
            MonitorError: A parameter is missing, unknown, or given twice.
        """
        known = self._keywords()
        for name in given:
            if name not in known:
                raise MonitorError(
                    f"{shown(name)} is no parameter of {self.name}; it has {', '.join(known)}",
                    value=name,
                )
            if given.count(name) > 1:
                raise MonitorError(f"{name} is given twice; give it once", value=name)
        for name, default in known.items():
            if default is Parameter.empty and name not in given:
                raise MonitorError(f"{name} is missing; give its bounds, too", value=name)

    def _keywords(self) -> dict[str, Any]:
        """The parameters' defaults by name."""
        taken = signature(self.function).parameters
        return {
            name: each.default
            for name, each in taken.items()
            if each.kind is Parameter.KEYWORD_ONLY
        }


def _ends(value: Interval | float) -> tuple[float, float]:
    both = as_interval(value)
    return float(both.inf), float(both.sup)


MODELS: Final = {
    model.name if model.part is None else f"{model.name}.{model.part}": model
    for model in (
        Model("constant", None, None),
        Model("alternating_capacitance", None, "F"),
        Model("alternating_capacitance_paper", None, "F"),
        Model("harmonic_capacitance", None, "F"),
        Model("capacitive_chain", "frequency", "Hz"),
        Model("capacitive_chain", "current", "A"),
        Model("moving_plate", "distance", "m"),
        Model("moving_plate", "capacitance", "F"),
        Model("proximity", "distance", "m"),
        Model("proximity", "inductance", "H"),
        Model("proximity", "frequency", "Hz"),
        Model("resonance", "inductance", "H"),
        Model("resonance", "oscillation", "Hz"),
        Model("resonance", "current", "A"),
        Model("touch", "area", "m2"),
        Model("touch", "capacitance", "F"),
        Model("touch", "energy", "J"),
    )
}
"""All quantities by name."""

UNITS: Final[Mapping[str, str | None]] = {
    "value": None,
    "area": "m2",
    "base_inductance": "H",
    "capacitance": "F",
    "damping": "m-1",
    "distance": "m",
    "distance_amplitude": "m",
    "frequency": "Hz",
    "inductance_change": "H",
    "maximum_area": "m2",
    "maximum_capacitance": "F",
    "maximum_distance": "m",
    "maximum_inductance": "H",
    "mean_distance": "m",
    "minimum_area": "m2",
    "minimum_capacitance": "F",
    "minimum_distance": "m",
    "minimum_inductance": "H",
    "relative_permittivity": "1",
    "resistance": "Ohm",
    "source_frequency": "Hz",
    "transconductance": "S",
    "vacuum_permittivity": "F/m",
    "voltage": "V",
}
"""UCUM code of each parameter; ``None`` for the channel's own."""

_SINUSOID: Final = {
    "minimum_capacitance": (9e-12, 1.1e-11),
    "maximum_capacitance": (9e-11, 1.1e-10),
}
DEFAULTS: Final[Mapping[str, Mapping[str, tuple[float, float]]]] = {
    "alternating_capacitance": _SINUSOID,
    "alternating_capacitance_paper": _SINUSOID,
    "harmonic_capacitance": _SINUSOID,
    "capacitive_chain": {
        **_SINUSOID,
        "resistance": (900.0, 1100.0),
        "transconductance": (9e-7, 1.1e-6),
    },
    "moving_plate": {
        "area": (9e-5, 1.1e-4),
        "minimum_distance": (9e-4, 1.1e-3),
        "maximum_distance": (4.5e-3, 5.5e-3),
    },
    "proximity": {
        "base_inductance": (9e-3, 1.1e-2),
        "inductance_change": (4.5e-3, 5.5e-3),
        "damping": (9.0, 11.0),
        "capacitance": (9e-7, 1.1e-6),
        "mean_distance": (1.8e-2, 2.2e-2),
        "distance_amplitude": (9e-3, 1.1e-2),
    },
    "resonance": {
        "voltage": (0.9, 1.1),
        "resistance": (4.0, 6.0),
        "capacitance": (9e-7, 1.1e-6),
        "source_frequency": (1000.0, 1000.0),
        "minimum_inductance": (8.1e-3, 9.9e-3),
        "maximum_inductance": (9.9e-3, 1.21e-2),
        "frequency": (1.0, 1.0),
    },
    "touch": {
        "minimum_area": (9e-6, 1.1e-5),
        "maximum_area": (9e-5, 1.1e-4),
        "distance": (9e-4, 1.1e-3),
        "voltage": (0.45, 0.55),
    },
}
"""For each function the paper's values ± 10 %; frequencies are exact, as a wide one soon blurs the
tube. The paper states no values for the capacitance and amplitude of eq. 14."""
