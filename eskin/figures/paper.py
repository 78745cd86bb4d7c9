"""What the paper's text states in numbers, beside what its equations give."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.constants import PAPER_VACUUM_PERMITTIVITY
from eskin.models import (
    alternating_capacitance_paper,
    alternating_current_paper,
    capacitance,
    chain_current,
    coil_current,
    proximity_at,
    rc_frequency,
    touch_of_area,
)
from eskin.models.icm import IcmParameters

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin.interval import Interval

_VACUUM: Final = {"vacuum_permittivity": PAPER_VACUUM_PERMITTIVITY}
_PLATE: Final = {"relative_permittivity": 1.0, "area": 1e-4, **_VACUUM}
_COIL: Final = {
    "base_inductance": 10e-3,
    "inductance_change": 5e-3,
    "damping": 10.0,
    "capacitance": 1e-6,
}
_RC: Final = {"resistance": 1e3, "capacitance": 100e-12}
_SWING: Final[dict[str, Any]] = {"minimum_capacitance": 10e-12, "maximum_capacitance": 100e-12}


@dataclass(frozen=True, slots=True)
class Statement:
    """One number of the text.

    Attributes:
        place: Where it stands.
        quantity: What it is.
        stated: The paper's number, in the unit.
        unit: SI unit.
        compute: Gives what the equations give.
        verdict: ``correct``, ``slip``, ``factor 1000`` and the like.
        remark: Why.
    """

    place: str
    quantity: str
    stated: float
    unit: str
    compute: Callable[[], float]
    verdict: str
    remark: str


def _mid(values: Interval) -> float:
    return float(values.mid)


def _plate_F(distance: float) -> float:  # noqa: N802 - the SI unit
    return _mid(capacitance(distance=distance, **_PLATE))


def _touch_F(area: float) -> float:  # noqa: N802 - the SI unit
    return _mid(touch_of_area(area, distance=1e-3, voltage=0.0, **_VACUUM).capacitance)


def _inductance_H(distance: float) -> float:  # noqa: N802 - the SI unit
    return _mid(proximity_at(distance, **_COIL).inductance)


def _chain_A(transconductance: float, share: float) -> float:  # noqa: N802 - the SI unit
    time = np.linspace(0.0, 1.0, 100_001)
    current = chain_current(time, transconductance=transconductance, **_SWING).mid
    return float(np.quantile(current, share))


def _peak_A(start: float, end: float) -> float:  # noqa: N802 - the SI unit
    time = np.linspace(start, end, 100_001)
    source: dict[str, Any] = {"voltage": 5.0, "voltage_frequency": 50.0}
    return float(np.max(np.abs(alternating_current_paper(time, **_SWING, **source).mid)))


def _icm(seconds: float, *, current: bool) -> float:
    sensor = IcmParameters()
    return _mid(sensor.magfes_current(seconds) if current else sensor.ecfes_voltage(seconds))


STATEMENTS: Final = (
    Statement(
        "Fig. 7b", "capacitance at 3 mm", 0.295e-12, "F", lambda: _plate_F(3e-3), "correct", "",
    ),
    Statement(
        "Fig. 7b", "capacitance at 4 mm, after 3 mm", 0.21e-12, "F", lambda: _plate_F(4e-3), "slip",
        "0.2213 pF; the next sentence has it as 0.22 pF",
    ),
    Statement(
        "Fig. 7b", "capacitance at 4 mm, after 5 mm", 0.22e-12, "F", lambda: _plate_F(4e-3),
        "correct", "",
    ),
    Statement(
        "Fig. 7b", "capacitance at 5 mm", 0.18e-12, "F", lambda: _plate_F(5e-3), "correct", "",
    ),
    Statement(
        "Fig. 8", "capacitance at 0.6 cm²", 0.5e-12, "F", lambda: _touch_F(0.6e-4), "correct",
        "0.53 pF, rounded",
    ),
    Statement(
        "Fig. 8", "capacitance at 0.8 cm², first sentence", 0.5e-12, "F", lambda: _touch_F(0.8e-4),
        "slip", "0.708 pF; the next sentence has it as over 0.7 pF",
    ),
    Statement(
        "Fig. 8", "capacitance at 0.8 cm², second sentence", 0.7e-12, "F", lambda: _touch_F(0.8e-4),
        "correct", "",
    ),
    Statement(
        "Fig. 5", "least current, G_m = 1 mA/V", 100e-9, "A", lambda: _chain_A(1e-3, 0.0),
        "factor 1000", "G_m = 1 µA/V gives it",
    ),
    Statement(
        "Fig. 5", "least current, if G_m were 1 µA/V", 100e-9, "A", lambda: _chain_A(1e-6, 0.0),
        "correct", "but this is not the paper's G_m",
    ),
    Statement(
        "Fig. 5", "current peaks, said to be microamperes", 1e-6, "A", lambda: _chain_A(1e-3, 1.0),
        "factor 1000", "1 mA with G_m = 1 mA/V",
    ),
    Statement(
        "Fig. 6", "current amplitude that is passed", 100e-9, "A", lambda: _peak_A(0.0, 0.125),
        "correct", "157 nA at 0.125 s, up from 15.7 nA; 100 nA are passed where C is 63.7 pF",
    ),
    Statement(
        "eq. 7", "least capacitance over a period", 10e-12, "F",
        lambda: float(
            np.min(alternating_capacitance_paper(np.linspace(0.0, 0.5, 100_001), **_SWING).mid)
        ),
        "wrong sign",
        "the plain sine takes C to −80 pF, negative from 0.259 s on; eq. 5's raised sine does not",
    ),
    Statement(
        "hand", "power of a taxel, 1 µF at 0.5 V once a second", 0.125e-6, "W",
        lambda: 0.5 * 1e-6 * 0.5**2, "correct", "for 1 µF; a taxel of this paper has picofarads",
    ),
    Statement(
        "hand", "power of 8400 taxels", 1050e-6, "W", lambda: 8400 * 0.5 * 1e-6 * 0.5**2, "correct",
        "likewise",
    ),
    Statement(
        "inductive", "inductance that 0.75 mm add, at 10 mm", 20e-6, "H",
        lambda: _inductance_H(10.75e-3) - _inductance_H(10e-3), "factor 1.7", "34 µH by eq. 11",
    ),
    Statement(
        "inductive", "inductance that 0.75 mm add, at 30 mm", 20e-6, "H",
        lambda: _inductance_H(30e-3) - _inductance_H(29.25e-3), "factor 1.4", "28 µH by eq. 11",
    ),
    Statement(
        "eq. 4", "frequency of 1 kΩ and 100 pF without 2π", 1e7, "Hz",
        lambda: _mid(rc_frequency(**_RC)), "factor 6.28", "eq. 6 has the 2π that eq. 4 lacks",
    ),
    Statement(
        "eq. 1", "impedance Z_L of 5 Ω at 1 kHz and 10 mH", 5.0, "Ohm",
        lambda: 1.0 / _mid(
            coil_current(voltage=1.0, resistance=5.0, inductance=10e-3, frequency=1e3).magnitude
        ),
        "factor 12.6", "ωL alone is 63 Ω: Z_L is the loss resistance",
    ),
    Statement(
        "Fig. 10a", "EcFES voltage after 1 ms", -1.0, "V", lambda: _icm(1e-3, current=False),
        "correct", "with R2 = 2419 Ω and ψ = −46°, which are ours: the paper gives none",
    ),
    Statement(
        "Fig. 10b", "MagFES current, a fraction of a mA: after 1 µs", -0.36e-3, "A",
        lambda: _icm(1e-6, current=True), "correct", "with R1 = 10 kΩ and ψ = −46°, which are ours",
    ),
    Statement(
        "Fig. 10b", "MagFES current, a fraction of a mA: after 1 ms", -0.24e-3, "A",
        lambda: _icm(1e-3, current=True), "correct", "likewise",
    ),
)  # fmt: skip


def write_statements(path: Path) -> Path:
    """Write ``paper.csv``.

    Raises:
        OSError: The file cannot be written.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["place", "quantity", "stated", "computed", "unit", "verdict", "remark"])
        for each in STATEMENTS:
            computed = each.compute()
            writer.writerow(
                [
                    *(each.place, each.quantity, repr(each.stated), repr(computed)),
                    *(each.unit, each.verdict, each.remark),
                ]
            )
    return path
