"""Units by their UCUM codes, with exact factors."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from typing import Final

_PREFIXES: Final = {
    "P": 15, "T": 12, "G": 9, "M": 6, "k": 3, "h": 2, "da": 1,
    "d": -1, "c": -2, "m": -3, "u": -6, "n": -9, "p": -12, "f": -15, "a": -18,
}  # fmt: skip
_BASE: Final = ("m", "s", "g", "K", "A", "mol", "cd", "rad")
_METRIC: Final[dict[str, tuple[Fraction, dict[str, int]]]] = {
    **{name: (Fraction(1), {name: 1}) for name in _BASE},
    "Hz": (Fraction(1), {"s": -1}),
    "N": (Fraction(1000), {"g": 1, "m": 1, "s": -2}),
    "Pa": (Fraction(1000), {"g": 1, "m": -1, "s": -2}),
    "bar": (Fraction(10**8), {"g": 1, "m": -1, "s": -2}),
    "J": (Fraction(1000), {"g": 1, "m": 2, "s": -2}),
    "W": (Fraction(1000), {"g": 1, "m": 2, "s": -3}),
    "C": (Fraction(1), {"A": 1, "s": 1}),
    "V": (Fraction(1000), {"g": 1, "m": 2, "s": -3, "A": -1}),
    "Ohm": (Fraction(1000), {"g": 1, "m": 2, "s": -3, "A": -2}),
    "S": (Fraction(1, 1000), {"g": -1, "m": -2, "s": 3, "A": 2}),
    "F": (Fraction(1, 1000), {"g": -1, "m": -2, "s": 4, "A": 2}),
    "H": (Fraction(1000), {"g": 1, "m": 2, "s": -2, "A": -2}),
    "Wb": (Fraction(1000), {"g": 1, "m": 2, "s": -2, "A": -1}),
    "T": (Fraction(1000), {"g": 1, "s": -2, "A": -1}),
    "l": (Fraction(1, 1000), {"m": 3}),
    "L": (Fraction(1, 1000), {"m": 3}),
}
_OTHER: Final[dict[str, tuple[Fraction, dict[str, int]]]] = {
    "%": (Fraction(1, 100), {}),
    "min": (Fraction(60), {"s": 1}),
    "h": (Fraction(3600), {"s": 1}),
    "d": (Fraction(86400), {"s": 1}),
}
_TERM: Final = re.compile(r"([./]?)(%|1|[A-Za-z]+)(-?\d{1,2})?", re.ASCII)


@dataclass(frozen=True)
class Unit:
    """A unit: ``value · scale + offset`` is the value in base units.

    Attributes:
        scale: Factor.
        offset: What is added, of Celsius only.
        dimension: Powers of base units, by name; the code of a unit that is not known here.
        code: As it was written; ``None`` of a product.
    """

    scale: Fraction = Fraction(1)
    offset: Fraction = Fraction(0)
    dimension: tuple[tuple[str, int], ...] = ()
    code: str | None = field(default=None, compare=False)

    def __str__(self) -> str:
        powers = [f"{name}{power if power != 1 else ''}" for name, power in self.dimension]
        return self.code or ".".join(powers) or "1"

    def times(self, other: Unit, power: int = 1) -> Unit:
        """The product with a power of another unit, both without offset."""
        powers = dict(self.dimension)
        for name, exponent in other.dimension:
            powers[name] = powers.get(name, 0) + power * exponent
        kept = tuple(sorted((name, power) for name, power in powers.items() if power))
        return Unit(self.scale * other.scale**power, Fraction(0), kept)

    @property
    def difference(self) -> Unit:
        """The unit of a difference: of Celsius, kelvin."""
        return Unit(self.scale, Fraction(0), self.dimension)


ONE: Final = Unit()
CELSIUS: Final = Unit(Fraction(1), Fraction(27315, 100), (("K", 1),), "Cel")


@lru_cache(1024)
def known_unit(code: str) -> Unit | None:
    """The unit of a UCUM code; ``None`` where it is not known here."""
    if code == "Cel":
        return CELSIUS
    unit, place = ONE, 0
    while place < len(code):
        match = _TERM.match(code, place)
        if match is None or bool(match[1]) != bool(place):
            return None
        part = _symbol(match[2])
        if part is None:
            return None
        power = int(match[3] or 1)
        unit = unit.times(part, -power if match[1] == "/" else power)
        place = match.end()
    return replace(unit, code=code) if code else None


def unit_of(code: str) -> Unit:
    """The unit of a code; one that is not known here fits only itself."""
    return known_unit(code) or Unit(dimension=((code, 1),), code=code)


def _symbol(text: str) -> Unit | None:
    if text == "1":
        return ONE
    found = _METRIC.get(text) or _OTHER.get(text)
    power = 0
    if found is None:
        for prefix, exponent in _PREFIXES.items():
            if text.startswith(prefix) and text[len(prefix) :] in _METRIC:
                found, power = _METRIC[text[len(prefix) :]], exponent
                break
    if found is None:
        return None
    scale, powers = found
    return Unit(scale * Fraction(10) ** power, Fraction(0), tuple(sorted(powers.items())))
