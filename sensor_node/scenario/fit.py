"""Whether a taxel can be part of a scenario; each refusal is one line with file and reason."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.errors import ScenarioError
from sensor_node.scenario.file import read_scenario

if TYPE_CHECKING:
    from sensor_node.scenario.script import Script

_ROUNDING: Final = 1e-9


def script_with(scenario: str, place: str) -> Script:
    """Read a scenario in whose skin there is a place.

    Raises:
        ValueError: It cannot be read, or has no such place; with its file.
    """
    try:
        script = read_scenario(scenario)
    except ScenarioError as error:
        raise ValueError(str(error)) from error
    names = script.skin.build().names
    if place not in names:
        raise ValueError(
            f"{scenario}: skin: place {place!r} is not there; it has {names[0]} to {names[-1]}"
        )
    return script


def require_pressure(script: Script, most: float) -> None:
    """Refuse contacts that press more than a taxel's data sheet allows, in Pa.

    Raises:
        ValueError: They may.
    """
    if script.peak_pressure > most:
        raise ValueError(
            f"the scenario's contacts press with up to {script.peak_pressure:.4g} Pa, "
            f"pressure_max_Pa is {most!r}"
        )


def require_room(script: Script, plate_area: float) -> None:
    """Refuse plates that are larger than a taxel of the skin, in m².

    Raises:
        ValueError: They are.
    """
    cell = script.skin.build().cell_area
    if plate_area > cell * (1.0 + _ROUNDING):
        raise ValueError(
            f"plate_area_m2 = {plate_area!r} is more than a taxel of the scenario's skin has, "
            f"{cell:.6g}"
        )
