"""From ADC codes back to the quantities: each result encloses the truth.

Known are the parts' tolerances and the noise's reach. A saturated code leaves the side open that it
does not bound, on every quantity that follows from it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from eskin.interval import Interval
from sensor_node.constants import EPSILON_0, TWO_PI
from sensor_node.converter import Converter
from sensor_node.taxels import CapacitiveSection, InductiveSection, TouchSection

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sensor_node.converter import Codes
    from sensor_node.taxels import AnyTaxel, HybridSection


class Inversion(Protocol):
    """Turns a taxel's codes into intervals."""

    def measure(self, codes: Mapping[str, Codes]) -> dict[str, Interval]:
        """Quantity to intervals, as many as there are codes."""


class RcInversion:
    """I → C over the chain of Fig. 3: ``C = Gm / (2π·R·f_ref·I)``."""

    def __init__(self, taxel: CapacitiveSection | TouchSection) -> None:
        self._converter = Converter(taxel.adc_min, taxel.adc_max, taxel.adc_bits)
        resistance = Interval.relative(taxel.resistance_ohm, taxel.resistance_tolerance)
        reference = Interval.relative(taxel.reference, taxel.reference_tolerance)
        transconductance = Interval.relative(
            taxel.transconductance, taxel.transconductance_tolerance
        )
        self._factor = transconductance / (TWO_PI * resistance * reference)

    def current(self, codes: Mapping[str, Codes], reach: float) -> Interval:
        """The converter's current in A."""
        return widen(self._converter.enclose(codes["current"]), reach)

    def capacitance(self, current: Interval) -> Interval:
        """The oscillator's capacitance in F."""
        return falling(current, self._factor / not_negative(current))


class CapacitiveInversion:
    """Capacitance and current of a capacitive taxel."""

    def __init__(self, taxel: CapacitiveSection) -> None:
        self._chain = RcInversion(taxel)
        self._reach = taxel.noise.reach

    def measure(self, codes: Mapping[str, Codes]) -> dict[str, Interval]:
        """Capacitance in F, current in A."""
        current = self._chain.current(codes, self._reach)
        return {"capacitance": self._chain.capacitance(current), "current": current}


class TouchInversion:
    """Area, capacitance and energy of a touch: ``A = C·d/ε``, ``E = ½CV²``."""

    def __init__(self, taxel: TouchSection) -> None:
        self._chain = RcInversion(taxel)
        distance = Interval.relative(taxel.plate_distance_m, taxel.plate_distance_tolerance)
        self._per_area = Interval(EPSILON_0) * taxel.relative_permittivity / distance
        self._area_reach = taxel.noise.reach
        self._capacitance_reach = float((self._per_area * self._area_reach).sup)
        supply = Interval.relative(taxel.supply, taxel.supply_tolerance)
        self._half_square = supply.sqr() * 0.5

    def measure(self, codes: Mapping[str, Codes]) -> dict[str, Interval]:
        """Area in m², capacitance in F, energy in J."""
        sensed = self._chain.capacitance(self._chain.current(codes, 0.0))
        capacitance = widen(sensed, self._capacitance_reach)
        return {
            "area": widen(sensed / self._per_area, self._area_reach),
            "capacitance": capacitance,
            "energy": capacitance * self._half_square,
        }


class InductiveInversion:
    """Frequency, inductance and distance: ``L = 1/((2πf)²·C)``, ``d = -ln((L0 - L)/ΔL)/alpha``."""

    def __init__(self, taxel: InductiveSection) -> None:
        self._converter = Converter(taxel.adc_min, taxel.adc_max, taxel.adc_bits)
        self._reach = taxel.noise.reach
        self._reference = Interval.relative(taxel.reference, taxel.reference_tolerance)
        self._capacitance = Interval.relative(taxel.capacitance, taxel.capacitance_tolerance)
        self._base = Interval.relative(taxel.inductance, taxel.inductance_tolerance)
        self._change = Interval.relative(taxel.inductance_change, taxel.inductance_change_tolerance)
        self._damping = Interval.relative(taxel.damping_per_m, taxel.damping_tolerance)

    def measure(self, codes: Mapping[str, Codes]) -> dict[str, Interval]:
        """Frequency in Hz, inductance in H, distance in m."""
        frequency = widen(self._converter.enclose(codes["voltage"]), self._reach) * self._reference
        square = (not_negative(frequency) * TWO_PI).sqr()
        inductance = falling(frequency, square.recip() / self._capacitance)
        return {
            "frequency": frequency,
            "inductance": inductance,
            "distance": falling(frequency, self._distance(inductance)),
        }

    def _distance(self, inductance: Interval) -> Interval:
        ratio = (self._base - inductance) / self._change
        # Before the coil the ratio lies in (0, 1]. Where it does not, something is broken or noise
        # went beyond its reach, and nothing is known.
        possible = (ratio.sup > 0.0) & (ratio.inf <= 1.0)
        inside = Interval(
            np.where(possible, np.clip(ratio.inf, 0.0, 1.0), 1.0),
            np.where(possible, np.clip(ratio.sup, 0.0, 1.0), 1.0),
        )
        distance = -inside.log() / self._damping
        return Interval(
            np.where(possible, distance.inf, -np.inf), np.where(possible, distance.sup, np.inf)
        )


class HybridInversion:
    """Current and voltage behind their amplifiers."""

    def __init__(self, taxel: HybridSection) -> None:
        self._converter = Converter(-taxel.adc_max, taxel.adc_max, taxel.adc_bits)
        self._reach = taxel.noise.reach
        self._gains = {
            "current": Interval.relative(taxel.current_gain, taxel.current_gain_tolerance),
            "voltage": Interval.relative(taxel.voltage_gain, taxel.voltage_gain_tolerance),
        }

    def measure(self, codes: Mapping[str, Codes]) -> dict[str, Interval]:
        """Current in A, voltage in V."""
        return {
            quantity: widen(self._converter.enclose(codes[quantity]), self._reach) / gain
            for quantity, gain in self._gains.items()
        }


def build_inversion(taxel: AnyTaxel) -> Inversion:
    """The inversion for a taxel's kind."""
    if isinstance(taxel, CapacitiveSection):
        return CapacitiveInversion(taxel)
    if isinstance(taxel, TouchSection):
        return TouchInversion(taxel)
    if isinstance(taxel, InductiveSection):
        return InductiveInversion(taxel)
    return HybridInversion(taxel)


def widen(values: Interval, reach: float) -> Interval:
    """Take in noise of at most ``reach``."""
    return values + Interval(-reach, reach) if reach > 0.0 else values


def not_negative(values: Interval) -> Interval:
    """The part at or above zero; ``[0, inf]``, nothing known, where noise left none above it."""
    known = values.sup > 0.0
    return Interval(
        np.where(known, np.maximum(values.inf, 0.0), 0.0), np.where(known, values.sup, np.inf)
    )


def falling(cause: Interval, effect: Interval) -> Interval:
    """Leave open, on a quantity that falls with its cause, the sides that the cause leaves open."""
    return Interval(
        np.where(np.isinf(cause.sup), -np.inf, effect.inf),
        np.where(np.isinf(cause.inf), np.inf, effect.sup),
    )
