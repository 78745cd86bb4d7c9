"""Comparisons that a node evaluates sample by sample, from the bounds of several quantities."""

from array import array

from eskin_sensor_node.firmware.monitor import (
    CERTAIN,
    IMPOSSIBLE,
    POSSIBLE,
    Atom,
)
from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin_sensor_node.firmware.inversion.codes import Bounds
    from eskin_sensor_node.firmware.monitor import Source
    from eskin_sensor_node.firmware.taxel.taxel import Taxel

    Expression = Callable[[], Bounds]
    """Gives lower and upper bound by the latest samples."""


class Meter:
    """Measures a taxel sample by sample.

    Args:
        source: Its samples.
        taxel: Its calibration.

    Attributes:
        source: Its samples.
        taxel: Its calibration.
        around: Meters of its neighbours in the skin.
        is_read: Whether an atom reads it; else it is measured for its neighbours.
        bounds: A lower and an upper bound of each quantity.
    """

    def __init__(self, source: "Source", taxel: "Taxel") -> None:
        self.source = source
        self.taxel = taxel
        self.around: Sequence[Meter] = ()
        self.is_read = False
        self.bounds = [array("d", [0.0]) for _ in range(2 * len(taxel.quantities))]

    def measure(self) -> None:
        """Calculate its latest sample back, as if it were alone."""
        codes = [array("q", [code]) for code in self.source.readings[0]]
        self.taxel.measure(codes, 1, self.bounds)

    def separate(self) -> None:
        """Subtract the crosstalk of neighbours that were sampled at the same instant."""
        around = [
            each.taxel.felt(each.bounds)
            for each in self.around
            if each.source.fresh and not each.source.broken
        ]
        self.taxel.separate(1, self.bounds, around)

    def quantity(self, number: int) -> "Expression":
        """One of its quantities."""
        lo, hi = self.bounds[2 * number], self.bounds[2 * number + 1]
        return lambda: (lo[0], hi[0])


class Comparison(Atom):
    """Whether an expression is positive, or not negative.

    Args:
        sources: The taxels that it reads.
        difference: The expression.
        strict: Whether it must be greater than 0.
        derived: As of every atom.
    """

    def __init__(
        self,
        sources: "Sequence[Source]",
        difference: "Expression",
        *,
        strict: bool,
        derived: bool,
    ) -> None:
        super().__init__(sources, POSSIBLE, derived=derived)
        self._difference = difference
        self._strict = strict

    def compare(self) -> int:
        """The verdict by the latest samples."""
        lo, hi = self._difference()
        if lo > 0.0 or (lo == 0.0 and not self._strict):
            return CERTAIN
        return POSSIBLE if hi > 0.0 or (hi == 0.0 and not self._strict) else IMPOSSIBLE


def number(lo: float, hi: float) -> "Expression":
    """A constant between two floats."""
    return lambda: (lo, hi)


def negated(x: "Expression") -> "Expression":
    """``-x``."""

    def bounds() -> "Bounds":
        lo, hi = x()
        return -hi, -lo

    return bounds


def absolute(x: "Expression") -> "Expression":
    """``abs(x)``."""

    def bounds() -> "Bounds":
        lo, hi = x()
        if lo >= 0.0:
            return lo, hi
        return (-hi, -lo) if hi <= 0.0 else (0.0, max(-lo, hi))

    return bounds


def total(x: "Expression", y: "Expression") -> "Expression":
    """``x + y``."""

    def bounds() -> "Bounds":
        (a, b), (c, d) = x(), y()
        # Infinity less infinity is not a number: then nothing is known of that side.
        lo, hi = a + c, b + d
        return down(lo) if lo == lo else -INFINITY, up(hi) if hi == hi else INFINITY  # noqa: PLR0124

    return bounds


def product(x: "Expression", lo: float, hi: float) -> "Expression":
    """``x`` times a number between two floats of one sign."""

    def bounds() -> "Bounds":
        a, b = x()
        if hi <= 0.0:
            a, b, least, most = -b, -a, -hi, -lo
        else:
            least, most = lo, hi
        return down(a * (least if a >= 0.0 else most)), up(b * (most if b >= 0.0 else least))

    return bounds


def extreme(parts: "Sequence[Expression]", *, least: bool) -> "Expression":
    """The least of some expressions, or the greatest one."""
    choose = min if least else max

    def bounds() -> "Bounds":
        found = [part() for part in parts]
        return choose([lo for lo, _ in found]), choose([hi for _, hi in found])

    return bounds
