"""Intervals as SenML (RFC 8428): lower and upper bounds are records of their own.

SenML knows numbers, not intervals. So each sample gives a record ``lo`` and a record ``hi`` at its
time; where a side is unbounded its record is left out, as is all of a missing sample. What holds
for the whole pack comes first, under names such as ``coverage``. The base time is a whole second,
and a new one comes with a record whose time is far from the last: so a time after it, read as a
float64 and rounded to whole ns, is exact.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2
import orjson

from eskin.wire.timestamp import SECOND

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

JSON: Final = "application/senml+json"
CBOR: Final = "application/senml+cbor"

EARLIEST: Final = 2**28 * SECOND
"""UTC ns. Below, a number is a time before or after now (RFC 8428, section 4.5.3)."""

RATIO: Final = "/"
SECONDS: Final = "s"
_UNITS: Final = {
    unit: unit for unit in ("A", "Cel", "F", "H", "Hz", "J", "K", "Pa", "V", "m", "m2", "rad", "s")
} | {"1": RATIO, "%": "%RH"}
"""UCUM code: SenML's unit (section 12.1). Percent are of relative humidity here."""
_FAR: Final = 2**22
"""s; up to here floats lie less than a ns apart."""
_LABELS: Final = {"bn": -2, "bt": -3, "bu": -4, "n": 0, "u": 1, "v": 2, "t": 6}
"""CBOR's labels (table 4)."""


class Pack(NamedTuple):
    """Interval samples of one channel.

    Attributes:
        name: Base name, such as ``fingertip/t01.capacitance/``.
        unit: UCUM code.
        t0: UTC ns, `EARLIEST` at least.
        t: ns after ``t0`` of each sample.
        lo: Lower bounds.
        hi: Upper bounds.
        about: Other records by name, each a value and its SenML unit.
    """

    name: str
    unit: str
    t0: int
    t: Sequence[int]
    lo: Sequence[float]
    hi: Sequence[float]
    about: Mapping[str, tuple[float, str]]

    def records(self) -> Iterator[dict[str, Any]]:
        """All records in order, by JSON's labels."""
        start, rest = divmod(self.t0, SECOND)
        base: dict[str, Any] = {"bn": self.name, "bt": start}
        if self.unit in _UNITS:
            base["bu"] = _UNITS[self.unit]
        for name, (value, unit) in self.about.items():
            yield base | {"n": name, "u": unit, "v": value}
            base = {}
        moved = 0
        for t, lo, hi in zip(self.t, self.lo, self.hi, strict=True):
            whole = (rest + t) // SECOND
            if abs(whole - moved) >= _FAR:
                moved = whole
                base["bt"] = start + moved
            at = (rest + t - moved * SECOND) / SECOND
            if lo != -math.inf:
                yield base | {"n": "lo", "t": at, "v": lo}
                base = {}
            if hi != math.inf:
                yield base | {"n": "hi", "t": at, "v": hi}
                base = {}


def seconds(nanoseconds: int) -> float:
    """A length of time in s, rounded up."""
    nearest = nanoseconds / SECOND
    below = Fraction(nearest) < Fraction(nanoseconds, SECOND)
    return math.nextafter(nearest, math.inf) if below else nearest


def as_json(pack: Pack) -> bytes:
    """Write a pack as JSON (section 5)."""
    return orjson.dumps(list(pack.records()))


def as_cbor(pack: Pack) -> bytes:
    """Write a pack as CBOR (section 6)."""
    return cbor2.dumps(
        [{_LABELS[label]: v for label, v in record.items()} for record in pack.records()]
    )
