"""What is known of a formula before there is data: units, horizons, exactness."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.errors import MonitorError
from eskin.interval import Interval
from eskin.monitor.formula import (
    MAX_BOUND,
    Absolute,
    Add,
    Atom,
    Channel,
    Constant,
    Count,
    Deviation,
    Divide,
    Expression,
    Fall,
    Formula,
    Historically,
    Implies,
    Maximum,
    Minimum,
    Multiply,
    Negate,
    Not,
    Once,
    Reach,
    Rise,
    Since,
    Subtract,
    Until,
    Window,
    time_text,
)
from eskin.monitor.units import ONE, Unit, known_unit, unit_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from eskin.monitor.formula import Node, Variable


class Horizon(NamedTuple):
    """How far from t a formula looks, in ns; ``None`` where it is unbounded.

    Attributes:
        past: Samples that hold after t - past count.
        future: Samples that hold before t + future count.
    """

    past: int | None
    future: int | None


@dataclass(frozen=True)
class Exactness:
    """Whether *possible* always means that both answers are possible; true if so.

    It holds where instants are exact, too. Otherwise verdicts are sound, and some that could be
    certain or impossible are possible.

    Attributes:
        reasons: Why not; empty if it is exact.
    """

    reasons: tuple[str, ...]

    def __bool__(self) -> bool:
        return not self.reasons


def check(formula: Formula, units: Mapping[str, str], *, bounded: bool = False) -> Horizon:
    """Check a formula against the channels that it is to read.

    Args:
        formula: What to check.
        units: UCUM code of each channel.
        bounded: Whether the memory is bounded, as on a node: then all windows must be.

    Returns:
        How far it looks.

    Raises:
        MonitorError: A channel is unknown, units do not fit, or a window is unbounded or too long.
    """
    _require_known(formula, units)
    units = {**units, **deviation_units(formula, units)}
    for node in formula.walk():
        if isinstance(node, Atom):
            comparison_of(node, Columns(), units)
        if bounded and isinstance(node, Window | Reach) and node.bounds[1] is None:
            raise MonitorError(
                f"{type(node).__name__.lower()} has no last bound, and its memory would have none; "
                "write such as [0,10s]",
                column=node.column,
                value=node.bounds,
            )
    found = horizon(formula)
    for each in found:
        if each is not None and each > MAX_BOUND:
            raise MonitorError(
                f"windows together reach {time_text(each)}, beyond {MAX_BOUND} ns; shorten them",
                value=each,
            )
    return found


def deviation_units(formula: Formula, units: Mapping[str, str]) -> dict[str, str]:
    """UCUM code of each deviation: that of its channel.

    Raises:
        MonitorError: A prediction does not fit its channel.
    """
    found = {}
    for node in formula.deviations.values():
        found[node.name] = units[node.source]
        try:
            node.prediction.bounds(units[node.source])
        except MonitorError as error:
            raise MonitorError(error.reason, column=node.column, value=node.name) from error
    return found


def _require_known(formula: Formula, units: Mapping[str, str]) -> None:
    for node in formula.walk():
        if not isinstance(node, Channel):
            continue
        name = node.source if isinstance(node, Deviation) else node.name
        if name not in units:
            near = difflib.get_close_matches(name, units, n=1)
            remedy = (
                f"did you mean {near[0]}?" if near else f"there are {', '.join(units) or 'none'}"
            )
            raise MonitorError(
                f"unknown channel {name}; {remedy[:200]}", column=node.column, value=name
            )


def horizon(formula: Formula) -> Horizon:
    """How far a formula looks into the past and the future."""
    return merged_horizon(channel_horizons(formula).values())


def channel_horizons(formula: Formula) -> dict[str, Horizon]:
    """How far a formula looks at each channel."""
    found: dict[str, list[Horizon]] = {name: [] for name in formula.channels}
    waiting: list[tuple[Node, float, float]] = [(formula, 0, 0)]  # offsets from t, or infinite
    seen: set[tuple[int, float, float]] = set()
    while waiting:
        node, first, last = waiting.pop()
        if (id(node), first, last) in seen:
            continue
        seen.add((id(node), first, last))
        if isinstance(node, Channel):
            ends = node.delay - first, last - node.delay
            past, future = (None if math.isinf(each) else int(each) for each in ends)
            found[node.name].append(
                Horizon(
                    None if past is None else max(past, 0),
                    None if future is None else max(future, 0),
                )
            )
        elif isinstance(node, Window | Reach):
            a, b = node.bounds
            end = math.inf if b is None else b
            back = isinstance(node, Historically | Once | Since)
            window = (first - end, last - a) if back else (first + a, last + end)
            waiting.append((node.parts[-1], *window))
            if isinstance(node, Since):
                waiting.append((node.left, first - end, last))
            elif isinstance(node, Until):
                waiting.append((node.left, first, last + end))
        else:
            waiting.extend((part, first, last) for part in node.parts)
    return {name: merged_horizon(each) for name, each in found.items()}


def merged_horizon(horizons: Iterable[Horizon]) -> Horizon:
    """The horizon that holds some others."""
    each = list(horizons)
    return Horizon(_most([one.past for one in each]), _most([one.future for one in each]))


def _most(lengths: list[int | None]) -> int | None:
    known = [length for length in lengths if length is not None]
    return max(known, default=0) if len(known) == len(lengths) else None


class ExpressionValue(NamedTuple):
    """An expression's value.

    Attributes:
        value: The exact number of constants; intervals of channels; ``None`` if not evaluated.
        unit: ``None`` where it is that of what stands beside it.
    """

    value: Fraction | Interval | None
    unit: Unit | None


def comparison_of(
    atom: Atom, columns: Columns, units: Mapping[str, str]
) -> tuple[ExpressionValue, ExpressionValue]:
    """Both sides of a comparison in one unit.

    Args:
        atom: The comparison.
        columns: Intervals of each channel, of one shape; one without them is not evaluated.
        units: UCUM code of each channel.

    Raises:
        MonitorError: Units do not fit each other.
    """
    left, right = (_measure(side, columns, units) for side in (atom.left, atom.right))
    return _alike(left, right, atom)


def enclosed(value: Fraction) -> Interval:
    """The least interval around an exact number."""
    return Interval(*sides(value))


_LARGEST: Final = 1.7976931348623157e308


def sides(value: Fraction) -> tuple[float, float]:
    """The greatest float not above an exact number, and the least not below; infinite beyond."""
    try:
        near = float(value)
    except OverflowError:
        return (_LARGEST, math.inf) if value > 0 else (-math.inf, -_LARGEST)
    exact = Fraction(near)
    below = near if exact <= value else math.nextafter(near, -math.inf)
    above = near if exact >= value else math.nextafter(near, math.inf)
    return below, above


def as_interval(value: Fraction | Interval | None) -> Interval:
    """A value as intervals."""
    assert value is not None  # noqa: S101 - evaluated by the caller
    return enclosed(value) if isinstance(value, Fraction) else value


def _measure(  # noqa: PLR0911 - a line for each kind of expression
    node: Expression, columns: Columns, units: Mapping[str, str]
) -> ExpressionValue:
    """Evaluate an expression; units are checked in the same walk."""
    if isinstance(node, Channel):
        return ExpressionValue(columns.get(node.variable), unit_of(units[node.name]))
    if isinstance(node, Constant):
        return ExpressionValue(node.value, _constant_unit(node))
    parts = [_measure(part, columns, units) for part in node.parts if isinstance(part, Expression)]
    if isinstance(node, Negate | Absolute):
        value, unit = parts[0]
        _require_ratio(node, unit)
        if value is None:
            return parts[0]
        if isinstance(node, Negate):
            return ExpressionValue(-value, unit)
        return ExpressionValue(
            max(value, -value) if isinstance(value, Fraction) else abs(value), unit
        )
    if isinstance(node, Multiply | Divide):
        return _product(node, *parts)
    if isinstance(node, Add | Subtract):
        return _narrowed(node, _sum(node, *parts), columns, units)
    found = parts[0]
    for part in parts[1:]:
        one, other = _alike(found, part, node)
        found = ExpressionValue(_extreme(node, one.value, other.value), one.unit or other.unit)
    return found


class Columns(dict["Variable", Interval]):
    """Intervals of channels, of one shape."""

    def narrow(self, linear: Linear, value: Interval) -> Interval:
        """A sum again, narrower where it is known that errors are shared."""
        del linear
        return value


def _narrowed(
    node: Expression, found: ExpressionValue, columns: Columns, units: Mapping[str, str]
) -> ExpressionValue:
    if not isinstance(found.value, Interval):
        return found
    linear = linear_of(node, units)
    if linear is None or linear.unit != found.unit:
        return found
    return ExpressionValue(columns.narrow(linear, found.value), found.unit)


class Linear(NamedTuple):
    """A sum of channels times numbers.

    Attributes:
        terms: The number of each channel.
        constant: What is added.
        unit: Of the sum; ``None`` where it is that of what stands beside it.
    """

    terms: dict[Variable, Fraction]
    constant: Fraction
    unit: Unit | None

    def times(self, factor: Fraction, unit: Unit | None) -> Linear:
        """All of it times a number, in a unit."""
        terms = {variable: number * factor for variable, number in self.terms.items()}
        return Linear(terms, self.constant * factor, unit)

    def _in(self, unit: Unit | None) -> Linear:
        if self.unit is None or unit is None or self.unit == unit:
            return self
        return self.times(self.unit.scale / unit.scale, unit)

    def plus(self, other: Linear) -> Linear:
        """The sum with another one, in the unit of the first that has one."""
        unit = self.unit or other.unit
        one, two = self._in(unit), other._in(unit)
        terms = dict(one.terms)
        for variable, number in two.terms.items():
            terms[variable] = terms.get(variable, Fraction(0)) + number
        return Linear(terms, one.constant + two.constant, unit)


def linear_of(node: Expression, units: Mapping[str, str]) -> Linear | None:  # noqa: PLR0911 - a line for each kind
    """An expression as a sum of channels; ``None`` if it is none, or has temperatures in Cel."""
    if isinstance(node, Channel):
        unit = unit_of(units[node.name])
        return None if unit.offset else Linear({node.variable: Fraction(1)}, Fraction(0), unit)
    if isinstance(node, Constant):
        given = _constant_unit(node)
        return None if given is not None and given.offset else Linear({}, node.value, given)
    if not isinstance(node, Negate | Add | Subtract | Multiply | Divide):
        return None
    parts = [linear_of(part, units) for part in node.parts if isinstance(part, Expression)]
    known = [part for part in parts if part is not None]
    if len(known) < len(parts):
        return None
    if isinstance(node, Negate):
        return known[0].times(Fraction(-1), known[0].unit)
    one, other = known
    if isinstance(node, Add | Subtract):
        sign = Fraction(-1 if isinstance(node, Subtract) else 1)
        return one.plus(other.times(sign, other.unit))
    if isinstance(node, Multiply) and not one.terms:
        one, other = other, one
    if other.terms or other.unit not in (None, ONE) or other.constant == 0:
        return None
    factor = other.constant if isinstance(node, Multiply) else 1 / other.constant
    return one.times(factor, one.unit)


def _extreme(
    node: Expression, one: Fraction | Interval | None, other: Fraction | Interval | None
) -> Fraction | Interval | None:
    if one is None or other is None:
        return None
    least = isinstance(node, Minimum)
    if isinstance(one, Fraction) and isinstance(other, Fraction):
        return min(one, other) if least else max(one, other)
    x, y = as_interval(one), as_interval(other)
    return x.lesser(y) if least else x.greater(y)


def _product(
    node: Multiply | Divide, one: ExpressionValue, other: ExpressionValue
) -> ExpressionValue:
    for part in (one, other):
        _require_ratio(node, part.unit)
    power = 1 if isinstance(node, Multiply) else -1
    plain = one.unit is None and other.unit is None
    unit = None if plain else (one.unit or ONE).times(other.unit or ONE, power)
    x, y = one.value, other.value
    if isinstance(y, Fraction) and y == 0 and power < 0:
        raise MonitorError("a division by 0; correct the constant", column=node.column, value=0)
    if x is None or y is None:
        return ExpressionValue(None, unit)
    if isinstance(x, Fraction) and isinstance(y, Fraction):
        return ExpressionValue(x * y if power > 0 else x / y, unit)
    left, right = as_interval(x), as_interval(y)
    if power > 0:
        return ExpressionValue(left * right, unit)
    holds_zero = (right.inf <= 0.0) & (right.sup >= 0.0)
    return ExpressionValue(Interval.where(holds_zero, Interval.entire(), left / right), unit)


def _sum(node: Add | Subtract, one: ExpressionValue, other: ExpressionValue) -> ExpressionValue:
    minus = isinstance(node, Subtract)
    u, v = one.unit, other.unit
    offsets = [unit is not None and unit.offset != 0 for unit in (u, v)]
    unit: Unit | None
    if offsets == [True, True]:
        if not minus:
            raise MonitorError(
                "two temperatures in Cel do not add; add a difference in K",
                column=node.column,
                value=str(node),
            )
        x, y = _alike(one, other, node)
        unit = x.unit.difference if x.unit else None
    elif any(offsets):
        if offsets[1] and minus:
            raise MonitorError(
                "a temperature in Cel is subtracted from none; exchange them, or use K",
                column=node.column,
                value=str(node),
            )
        whole = u if offsets[0] else v
        assert whole is not None  # noqa: S101 - it has an offset
        x = one if offsets[0] else _converted(one, whole.difference, node)
        y = other if offsets[1] else _converted(other, whole.difference, node)
        unit = whole
    else:
        x, y = _alike(one, other, node)
        unit = x.unit or y.unit
    if x.value is None or y.value is None:
        return ExpressionValue(None, unit)
    if isinstance(x.value, Fraction) and isinstance(y.value, Fraction):
        return ExpressionValue(x.value - y.value if minus else x.value + y.value, unit)
    left, right = as_interval(x.value), as_interval(y.value)
    return ExpressionValue(left - right if minus else left + right, unit)


def _require_ratio(node: Expression, unit: Unit | None) -> None:
    if unit is not None and unit.offset != 0:
        raise MonitorError(
            f"{node} has no meaning for a temperature in Cel; take a difference, or use K",
            column=node.column,
            value=str(node),
        )


def _constant_unit(node: Constant) -> Unit | None:
    if node.unit is None:
        return None
    unit = known_unit(node.unit)
    if unit is None:
        raise MonitorError(
            f"unknown unit {node.unit}; use UCUM codes of SI units, such as kPa, m/s2, Cel or 1",
            column=node.column,
            value=node.unit,
        )
    return unit


def _alike(
    one: ExpressionValue, other: ExpressionValue, node: Node
) -> tuple[ExpressionValue, ExpressionValue]:
    """Two quantities in one unit; a constant is converted rather than a channel, as it is exact."""
    if one.unit is None or other.unit is None or one.unit == other.unit:
        return one, other
    if isinstance(one.value, Fraction):
        return _converted(one, other.unit, node), other
    return one, _converted(other, one.unit, node)


def _converted(given: ExpressionValue, unit: Unit, node: Node) -> ExpressionValue:
    value, own = given
    if own is None or own == unit:
        return ExpressionValue(value, unit)
    if own.dimension != unit.dimension:
        raise MonitorError(
            f"units do not fit in {node}: one side is in {own}, the other in {unit}; "
            "correct one of them",
            column=node.column,
            value=str(node),
        )
    ratio = own.scale / unit.scale
    offset = (own.offset - unit.offset) / unit.scale
    if value is None:
        return ExpressionValue(None, unit)
    if isinstance(value, Fraction):
        return ExpressionValue(value * ratio + offset, unit)
    moved = value if ratio == 1 else value * enclosed(ratio)
    return ExpressionValue(moved if offset == 0 else moved + enclosed(offset), unit)


def is_exact(formula: Formula, units: Mapping[str, str] | None = None) -> Exactness:
    """Whether the three verdicts of a formula are exact, where instants are.

    They are if each expression is exact in floats, and each channel occurs in one direction only:
    then one choice of all values makes every comparison true at once that can be true.

    Args:
        formula: Which one.
        units: UCUM code of each channel; ``None`` where each has that of what it is compared with.

    Raises:
        MonitorError: Units do not fit each other.
    """
    if units is not None:
        units = {**units, **deviation_units(formula, units)}
    reasons = [f"{name} is rounded outward" for name in formula.deviations]
    directions: dict[str, set[int]] = {}
    owners: dict[str, set[Atom]] = {}
    for atom, sign in _polarities(formula):
        reasons += _atom_reasons(atom) + _conversion_reasons(atom, units)
        for name, direction in _directions(atom).items():
            directions.setdefault(name, set()).add(direction * sign)
            owners.setdefault(name, set()).add(atom)
    for name, found in directions.items():
        mixed = found == {1, -1} or (0 in found and len(owners[name]) > 1)
        joint = 0 in found and any(len(atom.channels) > 1 for atom in owners[name])
        if mixed or joint or _both_ways(formula, name, found):
            reasons.append(f"{name} occurs in both directions")
    return Exactness(tuple(dict.fromkeys(reasons)))


def _both_ways(formula: Formula, name: str, found: set[int]) -> bool:
    """Whether the only comparison of a channel, with no direction, occurs in both polarities."""
    if 0 not in found:
        return False
    signs = {sign for atom, sign in _polarities(formula) if name in atom.channels}
    return len(signs) > 1


def _polarities(formula: Formula) -> list[tuple[Atom, int]]:
    """Each comparison with the signs in which it counts: 1, and -1 below a negation."""
    found: dict[tuple[Atom, int], None] = {}
    waiting: list[tuple[Node, int]] = [(formula, 1)]
    seen: set[tuple[int, int]] = set()
    while waiting:
        node, sign = waiting.pop()
        if (id(node), sign) in seen:
            continue
        seen.add((id(node), sign))
        if isinstance(node, Atom):
            found[node, sign] = None
        elif isinstance(node, Not):
            waiting.append((node.operand, -sign))
        elif isinstance(node, Implies):
            waiting += [(node.left, -sign), (node.right, sign)]
        elif isinstance(node, Rise | Fall):
            waiting += [(node.operand, 1), (node.operand, -1)]
        elif isinstance(node, Count) and not node.comparison.upward:
            waiting += [(part, -sign) for part in node.parts]
        else:
            waiting += [(part, sign) for part in node.parts]
    return list(found)


def _atom_reasons(atom: Atom) -> list[str]:
    used = [node.name for node in atom.walk() if isinstance(node, Channel)]
    reasons = [
        f"{name} occurs twice in {atom}" for name in dict.fromkeys(used) if used.count(name) > 1
    ]
    rounded = Add | Subtract | Multiply | Divide
    return reasons + [
        f"{node} is rounded outward"
        for node in atom.walk()
        if isinstance(node, rounded) and node.channels
    ]


def _conversion_reasons(atom: Atom, units: Mapping[str, str] | None) -> list[str]:
    """Where a channel is converted, or a constant becomes an interval, and is rounded."""
    known = set() if units is None else {unit_of(units[name]) for name in sorted(atom.channels)}
    if len(known) > 1:
        return [f"a channel in {atom} is converted to another unit, which is rounded outward"]
    reasons = []
    for node in atom.walk():
        if not (isinstance(node, Minimum | Maximum) and node.channels):
            continue
        for part in node.parts:
            if not isinstance(part, Expression) or part.channels:
                continue
            given = _measure(part, Columns(), {})
            for unit in known:
                given = _converted(given, unit, node)
            if isinstance(given.value, Fraction) and len(set(sides(given.value))) > 1:
                reasons.append(f"{part} in {node} is rounded outward")
    return reasons


def _directions(atom: Atom) -> dict[str, int]:
    """1 where a greater value of a channel helps a comparison, -1 where a less one does, else 0."""
    left, right = _slopes(atom.left), _slopes(atom.right)
    sign = 1 if atom.comparison.upward else -1
    found = {name: slope * sign for name, slope in left.items()}
    for name, slope in right.items():
        found[name] = _joined(found.get(name), -slope * sign)
    return found


def _joined(one: int | None, other: int) -> int:
    return other if one is None or one == other else 0


def _slopes(node: Expression) -> dict[str, int]:
    if isinstance(node, Channel):
        return {node.name: 1}
    parts = [_slopes(part) for part in node.parts if isinstance(part, Expression)]
    if isinstance(node, Negate):
        return {name: -slope for name, slope in parts[0].items()}
    if isinstance(node, Absolute | Multiply | Divide):
        return dict.fromkeys((name for part in parts for name in part), 0)
    found: dict[str, int] = {}
    for index, part in enumerate(parts):
        flip = -1 if index and isinstance(node, Subtract) else 1
        for name, slope in part.items():
            found[name] = _joined(found.get(name), flip * slope)
    return found
