"""From a pad's capacitance back to what presses it: each result encloses the truth.

The pad's model (`sensor_node.physics.pad`) backwards: ``P = E·(C/C0 - 1)``. From its mean pressure
P alone, contact area and plate distance are known within bounds: a contact covers the whole plate
at most, and presses with ``pressure_max_Pa`` at most.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.interval import Interval
from sensor_node.firmware.calibration import EPSILON_0
from sensor_node.physics.surroundings import REFERENCE_HUMIDITY, REFERENCE_TEMPERATURE

if TYPE_CHECKING:
    from sensor_node.taxels import PadSection

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
        self._rest = permittivity * EPSILON_0 * self._area / self._distance
        self._elasticity = Interval.relative(taxel.elasticity_Pa, taxel.elasticity_tolerance)
        self._per_kelvin = taxel.permittivity_per_K
        self._per_percent = taxel.permittivity_per_percent
        self._most = taxel.pressure_max_Pa

    def felt(self, capacitance: Interval, temperature: Interval, humidity: Interval) -> Interval:
        """Pressure that the pad feels in Pa, crosstalk included.

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
        ratio = capacitance * _EMULATION / (self._rest * ambient)
        return (ratio - 1.0) * self._elasticity

    def own(self, felt: Interval, crosstalk: float) -> Interval:
        """Its own mean pressure in Pa, where nothing is known of its neighbours.

        Where noise went beyond its reach nothing is known but ``[0, pressure_max_Pa]``.
        """
        whole = Interval(np.zeros(felt.shape), np.full(felt.shape, self._most))
        cut = whole.intersection(felt - Interval(0.0, crosstalk) * self._most)
        lost = cut.is_empty
        return Interval(np.where(lost, whole.inf, cut.inf), np.where(lost, whole.sup, cut.sup))

    def quantities(self, pressure: Interval) -> dict[str, Interval]:
        """What follows from its own mean pressure.

        Returns:
            Pressure in Pa, contact area in m², plate distance under the contact in m.
        """
        share = Interval(pressure.inf) * _EMULATION / self._most
        local = Interval(pressure.inf, np.full(pressure.shape, self._most)) * _EMULATION
        area = share * self._area
        return {
            "pressure": pressure,
            "contact_area": Interval(
                np.maximum(area.inf, 0.0), np.full(pressure.shape, float(self._area.sup))
            ),
            "plate_distance": self._distance / (local / self._elasticity + 1.0),
        }
