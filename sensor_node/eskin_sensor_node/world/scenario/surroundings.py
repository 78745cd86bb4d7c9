"""What surrounds a skin: the ``[ambient]`` and ``[bioelectric]`` tables of a scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, TypeAlias

import numpy as np
from pydantic import ConfigDict, Field, field_validator

from eskin.runtime.settings import Section

if TYPE_CHECKING:
    from eskin.interval import Floats

Temperature: TypeAlias = Annotated[float, Field(ge=-40, le=125)]
Humidity: TypeAlias = Annotated[float, Field(ge=0, le=100)]
Instant: TypeAlias = Annotated[float, Field(ge=0)]
# TOML has arrays only: a pair is read from one.
TemperaturePoint: TypeAlias = Annotated[tuple[Instant, Temperature], Field(strict=False)]
HumidityPoint: TypeAlias = Annotated[tuple[Instant, Humidity], Field(strict=False)]


class AmbientSection(Section):
    """Temperature and relative humidity: straight lines between points, level before and after."""

    model_config = ConfigDict(strict=True)

    temperature_Cel: list[TemperaturePoint] = Field(
        default=[(0.0, 20.0)], min_length=1, description="points [time in s, °C]"
    )
    humidity_percent: list[HumidityPoint] = Field(
        default=[(0.0, 50.0)], min_length=1, description="points [time in s, %]"
    )

    @field_validator("temperature_Cel", "humidity_percent")
    @classmethod
    def _in_order(cls, points: list[tuple[float, float]]) -> list[tuple[float, float]]:
        times = [time for time, _ in points]
        if sorted(set(times)) != times:
            raise ValueError("the points' times must rise")
        return points

    def temperature(self, seconds: Floats) -> Floats:
        """°C at times in s."""
        return _between(self.temperature_Cel, seconds)

    def humidity(self, seconds: Floats) -> Floats:
        """Relative humidity in % at times in s."""
        return _between(self.humidity_percent, seconds)


class BioelectricSection(Section):
    """A voltage that the body makes: one bell-shaped beat a period."""

    model_config = ConfigDict(strict=True)

    amplitude_V: float = Field(default=0.0, ge=0, description="height of a beat")
    rate_Hz: float = Field(default=1.2, gt=0, le=1000, description="beats in a second")
    width_s: float = Field(default=0.02, gt=0, description="standard deviation of the bell")

    def voltage(self, seconds: Floats) -> Floats:
        """The voltage in V at times in s; a beat's top stands in the middle of its period."""
        period = 1.0 / self.rate_Hz
        since = np.mod(seconds, period) - period / 2.0
        return np.asarray(self.amplitude_V * np.exp(-0.5 * (since / self.width_s) ** 2))


def _between(points: list[tuple[float, float]], seconds: Floats) -> Floats:
    times, values = zip(*points, strict=True)
    return np.asarray(np.interp(seconds, times, values))
