"""From a pad's capacitance back to what presses it: each result encloses the truth.

The pad's model (`kinds.pad`) backwards: the mean plate distance is ``d = ε·A/C``, and
what the pad feels ``E·(d0/d - 1)``. From its own mean pressure P alone, contact area and distance
under the contact are known within bounds: a contact covers the whole plate at most, and presses
with ``pressure_max_Pa`` at most.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.constants import VACUUM_PERMITTIVITY
from eskin.interval import Interval
from eskin_sensor_node.firmware.inversion.hygrometer import REFERENCE_HUMIDITY
from eskin_sensor_node.firmware.inversion.pad import REFERENCE_TEMPERATURE

if TYPE_CHECKING:
    from eskin_sensor_node.kinds.pad import PadSection

_EMULATION: Final = Interval(1.0 - 2.0**-46, 1.0 + 2.0**-46)
"""The emulated skin computes in float64, where a real one does not round: its few ulp."""


class PadInversion:
    """Turns capacitances of one pad into what presses it.

    Args:
        taxel: Its data sheet.
    """

    def __init__(self, taxel: PadSection) -> None:
        self._area = Interval.relative(taxel.plate_area_m2, taxel.plate_area_tolerance)
        self._distance = Interval.relative(taxel.plate_distance_m, taxel.plate_distance_tolerance)
        permittivity = Interval.relative(
            taxel.relative_permittivity, taxel.relative_permittivity_tolerance
        )
        self._plates = permittivity * VACUUM_PERMITTIVITY * self._area
        self._elasticity = Interval.relative(taxel.elasticity_Pa, taxel.elasticity_tolerance)
        self._per_kelvin = Interval.relative(
            taxel.permittivity_per_K, taxel.permittivity_per_K_tolerance
        )
        self._per_percent = Interval.relative(
            taxel.permittivity_per_percent, taxel.permittivity_per_percent_tolerance
        )
        self._most = taxel.pressure_max_Pa
        felt = Interval(0.0, self._most) * (1.0 + Interval(taxel.crosstalk))
        self.stated_distance = self._distance / (felt * _EMULATION / self._elasticity + 1.0)
        """Mean plate distance in m by the data sheet alone."""

    def plate_distance(
        self, capacitance: Interval, temperature: Interval, humidity: Interval
    ) -> Interval:
        """Mean plate distance in m: harmonic over the plate, crosstalk included.

        Args:
            capacitance: In F.
            temperature: In °C, broadcast.
            humidity: In %, broadcast.
        """
        ambient = (
            1.0
            + (temperature - REFERENCE_TEMPERATURE) * self._per_kelvin
            + (humidity - REFERENCE_HUMIDITY) * self._per_percent
        )
        return self._plates * ambient / (capacitance * _EMULATION)

    def felt(self, plate_distance: Interval) -> Interval:
        """Pressure that the pad feels in Pa, crosstalk included, from its mean plate distance."""
        return (self._distance / plate_distance - 1.0) * self._elasticity

    def quantities(self, pressure: Interval) -> dict[str, Interval]:
        """What follows from its own mean pressure.

        Returns:
            Pressure in Pa, contact area in m², distance under the contact in m.
        """
        share = Interval(pressure.inf) * _EMULATION / self._most
        local = Interval(pressure.inf, np.full(pressure.shape, self._most)) * _EMULATION
        area = share * self._area
        return {
            "pressure": pressure,
            "contact_area": Interval(
                np.maximum(area.inf, 0.0), np.full(pressure.shape, float(self._area.sup))
            ),
            "contact_distance": self._distance / (local / self._elasticity + 1.0),
        }
