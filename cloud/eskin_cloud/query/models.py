"""Which quantities of the ³S models may be asked for, and with which parameters."""

from __future__ import annotations

from dataclasses import dataclass
from inspect import Parameter, signature
from typing import TYPE_CHECKING, Any, Final

import eskin
from eskin.errors import QueryError
from eskin.interval import as_interval

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from eskin.interval import Interval


def constant(_time: Interval, *, value: Interval) -> Interval:
    """The same at all times: a band."""
    return value


@dataclass(frozen=True, slots=True)
class ModelParameter:
    """A parameter of a model.

    Attributes:
        name: Of the keyword of its function.
        unit: UCUM code; ``None`` where it is that of the channel.
        required: Whether it must be given.
        usual: Bounds to begin with: what is taken where it is left out, or the paper's value with
            its tolerance; ``None`` where there is none.
    """

    name: str
    unit: str | None
    required: bool
    usual: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class Model:
    """A quantity over time.

    Attributes:
        name: Of a function of `eskin.models`, or `constant`.
        part: Which of what it gives; ``None`` where it gives one.
        unit: UCUM code; ``None`` where it is whatever its parameters have.
    """

    name: str
    part: str | None
    unit: str | None

    @property
    def function(self) -> Callable[..., Any]:
        """Time and parameters to intervals."""
        return constant if self.name == "constant" else getattr(eskin.models, self.name)

    @property
    def description(self) -> str:
        """What it is, in one line."""
        return (self.function.__doc__ or "").partition("\n")[0].replace("``", "")

    @property
    def parameters(self) -> list[ModelParameter]:
        """All that it takes, in order."""
        usual = USUAL.get(self.name, {})
        return [
            ModelParameter(
                name,
                UNITS[name],
                required=default is Parameter.empty,
                usual=usual.get(name) if default is Parameter.empty else _ends(default),
            )
            for name, default in self._keywords().items()
        ]

    def require_parameters(self, given: Mapping[str, Interval]) -> None:
        """Check names.

        Raises:
            QueryError: One is missing, or none of the model's.
        """
        known = self._keywords()
        for name in given:
            if name not in known:
                raise QueryError("parameter", f"{name!r} is none of {', '.join(known)}")
        for name, default in known.items():
            if default is Parameter.empty and name not in given:
                raise QueryError("parameter", f"{name} is missing; give parameter={name}:LO:HI")

    def _keywords(self) -> dict[str, Any]:
        """Its parameters' defaults by name."""
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
"""All that may be asked for, by name."""

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

_SWING: Final = {
    "minimum_capacitance": (9e-12, 1.1e-11),
    "maximum_capacitance": (9e-11, 1.1e-10),
}
USUAL: Final[Mapping[str, Mapping[str, tuple[float, float]]]] = {
    "alternating_capacitance": _SWING,
    "alternating_capacitance_paper": _SWING,
    "harmonic_capacitance": _SWING,
    "capacitive_chain": {
        **_SWING,
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
"""For each function the paper's values with a tenth of tolerance; frequencies are thin, since a
wide one soon blurs the tube. The paper gives no values for eq. 14's capacitance and swing."""
