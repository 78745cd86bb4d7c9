"""Whether a taxel can be part of a scenario; each refusal is one line with file and reason."""

from __future__ import annotations

from typing import Final

from pydantic import Field, ValidationInfo, field_validator

from eskin.errors import ScenarioError
from eskin.runtime.settings import Section
from eskin_sensor_node.world.scenario.file import read_scenario
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

_ROUNDING: Final = 1e-9


class Played(Section):
    """Settings of all taxels that play a scenario."""

    scenario: str = Field(description="a scenario file, or a packaged one, such as hand.toml")

    @field_validator("scenario")
    @classmethod
    def _can_be_played(cls, value: str) -> str:
        try:
            read_scenario(value)
        except ScenarioError as error:
            raise ValueError(str(error)) from error
        return value


class Staged(Played):
    """What those have that are taxels of the scenario's skin."""

    place: str = Field(description="which taxel of the scenario's skin it is, such as t05")

    @field_validator("place")
    @classmethod
    def _is_there(cls, value: str, info: ValidationInfo) -> str:
        scenario = info.data.get("scenario")
        if scenario is not None:
            names = read_scenario(scenario).skin.build().names
            if value not in names:
                raise ValueError(f"the skin of {scenario} has {names[0]} to {names[-1]}")
        return value


def require_pressure(scenario: str, most: float) -> None:
    """Refuse contacts that press more than a taxel's data sheet allows, in Pa.

    Raises:
        ValueError: They may.
    """
    peak = read_scenario(scenario).peak_pressure
    if peak > most:
        raise ValueError(
            f"the scenario's contacts press with up to {peak:.4g} Pa, pressure_max_Pa is {most!r}"
        )


def require_room(scenario: str, plate_area: float) -> None:
    """Refuse plates that are larger than a taxel of the skin, in m².

    Raises:
        ValueError: They are.
    """
    cell = read_scenario(scenario).skin.build().cell_area
    if plate_area > cell * (1.0 + _ROUNDING):
        raise ValueError(
            f"plate_area_m2 = {plate_area!r} is more than a taxel of the scenario's skin has, "
            f"{cell:.6g}"
        )


def require_crosstalk(scenario: str, bound: float) -> None:
    """Check that a skin's crosstalk stays within a taxel's data sheet.

    Raises:
        ValueError: It may.
    """
    most = read_scenario(scenario).skin.crosstalk
    if most > bound:
        raise ValueError(f"crosstalk = {bound!r} is less than the scenario's skin has, {most!r}")


def require_sound(scenario: str, place: str, doubtful: int) -> None:
    """Refuse more stuck or worn taxels around a place than a taxel's data sheet allows for.

    Either may feel more than it reads. Water and hysteresis add to what a pad reads.

    Raises:
        ValueError: There are.
    """
    script = read_scenario(scenario)
    stuck = {each.taxel for each in script.departures if each.kind in {"stuck", "worn"}}
    if len(stuck) <= doubtful:
        return
    skin = script.skin.build()
    around = skin.neighbours[skin.numbers[place]]
    found = sorted(stuck & {skin.names[number] for number in around[around != NO_NEIGHBOUR]})
    if len(found) > doubtful:
        raise ValueError(
            f"{' and '.join(found)} beside {place} get stuck or wear in the scenario, "
            f"doubtful_neighbours is {doubtful}"
        )


def require_air(
    scenario: str, temperature: tuple[float, float], humidity: tuple[float, float]
) -> None:
    """Refuse air beyond what a taxel's data sheet states, in °C and %.

    Raises:
        ValueError: There is some.
    """
    ambient = read_scenario(scenario).ambient
    stated = (("temperature_Cel", temperature), ("humidity_percent", humidity))
    for key, (least, most) in stated:
        values = [value for _, value in getattr(ambient, key)]
        if min(values) < least or max(values) > most:
            raise ValueError(
                f"the scenario's {key} goes from {min(values):g} to {max(values):g}, "
                f"the data sheet from {least:g} to {most:g}"
            )
