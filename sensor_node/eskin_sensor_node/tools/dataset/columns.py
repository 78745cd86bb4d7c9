"""The columns of a dataset, with their units and meanings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import pyarrow as pa

TRUE: Final = "true"
LO: Final = "lo"
HI: Final = "hi"


@dataclass(frozen=True, slots=True)
class DatasetQuantity:
    """A quantity, which has a column for its truth and two for its interval.

    Attributes:
        name: Such as ``capacitance``.
        unit: As it stands in the columns' names; empty for a plain number.
        ucum: The same as a UCUM code.
        meaning: One line.
    """

    name: str
    unit: str
    ucum: str
    meaning: str

    def column(self, side: str) -> str:
        """Name of one of its columns, such as ``capacitance_lo_F``."""
        return f"{self.name}_{side}{'_' if self.unit else ''}{self.unit}"


PAD: Final = (
    DatasetQuantity(
        "capacitance", "F", "F", "capacitance at the oscillator, with crosstalk and faults"
    ),
    DatasetQuantity(
        "pressure", "Pa", "Pa", "mean pressure of the contacts over the taxel, without crosstalk"
    ),
    DatasetQuantity("contact_area", "m2", "m2", "area of the plate that contacts cover"),
    DatasetQuantity(
        "plate_distance", "m", "m", "mean distance of the plates (harmonic), with crosstalk"
    ),
    DatasetQuantity(
        "contact_distance", "m", "m", "distance of the plates under the contact, or at rest"
    ),
)
"""What pads give."""

COIL: Final = (
    DatasetQuantity("inductance", "H", "H", "inductance at the oscillator, with faults"),
    DatasetQuantity("frequency", "Hz", "Hz", "frequency of the LC oscillator"),
    DatasetQuantity("distance", "m", "m", "distance to the nearest metal"),
    DatasetQuantity("eddy_amplitude", "", "1", "coil current over that without metal"),
    DatasetQuantity("eddy_phase", "rad", "rad", "change of the coil current's phase"),
)
"""What coils give."""

SURROUNDINGS: Final = (
    DatasetQuantity("temperature", "Cel", "Cel", "ambient temperature"),
    DatasetQuantity("humidity", "percent", "%", "ambient humidity, relative"),
    DatasetQuantity("bioelectric", "V", "V", "voltage that the body makes"),
)
"""What is the same for all taxels."""

_KEYS: Final = (
    ("run", pa.int64(), "", "seed of the run"),
    ("time_s", pa.float64(), "s", "since the run's begin"),
    ("taxel", pa.string(), "", "its place in the skin"),
    ("label", pa.string(), "", "what happens to the taxel"),
    ("fault", pa.string(), "", "none, stuck, dead, worn, wet or hysteresis"),
)
_SIDES: Final = {TRUE: "truth", LO: "lower bound", HI: "upper bound"}


def schema(quantities: tuple[DatasetQuantity, ...]) -> pa.Schema:
    """Names, types, units and meanings, as Parquet keeps them."""
    fields = [_field(name, kind, unit, meaning) for name, kind, unit, meaning in _KEYS]
    fields += [
        _field(
            each.column(side),
            pa.float64(),
            each.ucum,
            f"{each.meaning}: {_SIDES[side]}",
        )
        for each in quantities
        for side in (TRUE, LO, HI)
    ]
    return pa.schema(fields)


def _field(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
    return pa.field(name, kind, nullable=False, metadata={"unit": unit, "meaning": meaning})
