"""What a scenario does to some taxels at some times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats

Labels: TypeAlias = "NDArray[np.int8]"


@dataclass(frozen=True, slots=True)
class Stimulus:
    """True causes, before any sensor; arrays of taxels × times, or of times alone.

    Attributes:
        covered: Share of a taxel that contacts cover, 0 to 1.
        pressure: Mean pressure of the contacts over the whole taxel, in Pa.
        felt: The same with what neighbours hand on (crosstalk), and with what remains of earlier
            contacts (hysteresis), in Pa.
        metal_distance: From the taxel to the nearest metal, in m.
        metal_quality: Reactance over resistance of that metal's eddy currents.
        labels: Index into `LABELS`.
        temperature: In °C, of times.
        humidity: Relative, in %, of times.
        bioelectric: In V, of times.
    """

    covered: Floats
    pressure: Floats
    felt: Floats
    metal_distance: Floats
    metal_quality: Floats
    labels: Labels
    temperature: Floats
    humidity: Floats
    bioelectric: Floats


def overlap(distance: Floats, radius: Floats, plate: float) -> Floats:
    """Area that two discs share (a lens of two circular segments), in m².

    Args:
        distance: Of their centres, in m; any shape.
        radius: Of the one, in m, broadcast.
        plate: Radius of the other.
    """
    smaller = np.minimum(radius, plate)
    apart, inside = distance >= radius + plate, distance <= np.abs(radius - plate)
    # Where the circles cut each other; elsewhere any numbers, which are then put aside.
    cutting = ~(apart | inside)
    d, r = np.where(cutting, distance, plate), np.where(cutting, radius, plate)
    toward_plate = np.clip((d**2 + plate**2 - r**2) / (2.0 * d * plate), -1.0, 1.0)
    toward_disc = np.clip((d**2 + r**2 - plate**2) / (2.0 * d * r), -1.0, 1.0)
    kite = (r + plate - d) * (d + r - plate) * (d - r + plate) * (d + r + plate)
    lens = (
        plate**2 * np.arccos(toward_plate)
        + r**2 * np.arccos(toward_disc)
        - 0.5 * np.sqrt(np.maximum(kite, 0.0))
    )
    within = np.where(inside, np.pi * smaller**2, 0.0)
    return np.asarray(np.where(cutting, np.clip(lens, 0.0, np.pi * smaller**2), within))
