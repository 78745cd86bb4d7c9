"""Formulas as programs for the firmware's monitors, and what they take of the machine."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Final

from eskin.errors import MonitorError
from eskin.monitor import Atom, Channel, Constant, check, parse
from eskin.monitor.checks import sides
from eskin.monitor.formula import (
    Absolute,
    Add,
    Always,
    Divide,
    Eventually,
    Expression,
    Maximum,
    Minimum,
    Multiply,
    Negate,
    Subtract,
    Until,
)
from eskin.monitor.program import Op, instructions
from eskin.monitor.units import Unit, known_unit, unit_of
from eskin_sensor_node.firmware import expression as firmware

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from eskin.monitor import Formula
    from eskin.monitor.formula import Node
    from eskin.monitor.program import Instruction
    from eskin_sensor_node.firmware.expression import Expression as Measured

_PASTS: Final[Mapping[type[Node], str]] = {
    Always: "historically",
    Eventually: "once",
    Until: "since",
}
_ATOM_CHANGES: Final = 3
"""Of a held value from one sample to the next: its end, the next value, and back."""
_MONITOR: Final = 512
_ATOM: Final = 320
_LINE: Final = 160
_RUN: Final = 2 * 16
"""Bytes as MicroPython lays objects out on 32 bits: a run is two integers of up to 16 bytes."""
_REMEMBERING: Final = frozenset({Op.ONCE, Op.HISTORICALLY, Op.SINCE})


@dataclass(frozen=True, slots=True)
class MonitorProgram:
    """A formula for a node.

    Attributes:
        formula: As it was parsed.
        lines: Its instructions.
        atoms: Its atoms, by their numbers.
        reach: ns of the past that it looks at.
    """

    formula: Formula
    lines: tuple[Instruction, ...]
    atoms: tuple[Atom, ...]
    reach: int

    @classmethod
    def compile(cls, text: str, units: Mapping[str, str]) -> MonitorProgram:
        """Compile a formula.

        Args:
            text: The formula.
            units: UCUM code of each of the node's channels.

        Raises:
            MonitorError: It is none, names other channels, looks at the future, or has an
                unbounded window.
        """
        formula = parse(text)
        for predicted in formula.deviations.values():
            raise MonitorError(
                "a node holds no models; compare with a constant, or run the monitor in the cloud",
                column=predicted.column,
                value=predicted.name,
            )
        past = check(formula, units, bounded=True).past or 0
        for node in formula.walk():
            if type(node) in _PASTS:
                name = type(node).__name__.lower()
                raise MonitorError(
                    f"{name} looks at the future, and a node acts at once; use "
                    f"{_PASTS[type(node)]} for it",
                    column=node.column,
                    value=name,
                )
        atoms = list(dict.fromkeys(node for node in formula.walk() if isinstance(node, Atom)))
        lines = instructions(formula, {atom: number for number, atom in enumerate(atoms)})
        return cls(formula, tuple(lines), tuple(atoms), past)

    @property
    def work(self) -> int:
        """Runs that its instructions take at a sample, at most, where none is missing."""
        changes: list[int] = []
        total = 0
        for op, operands, *_ in self.lines:
            if op == Op.ATOM:
                changes.append(_ATOM_CHANGES)
                total += 1
                continue
            taken = changes[len(changes) - operands :]
            del changes[len(changes) - operands :]
            # Of each side a run for two changes, and one more; counted are both ends of a run.
            total += sum(2 * 2 * (each // 2 + 1) for each in taken)
            grown = 2 if op in _REMEMBERING else 1
            changes.append(grown * sum(taken) + grown)
        return total

    @property
    def operations(self) -> int:
        """Of interval arithmetic in its comparisons, at most."""
        return sum(len([*atom.walk()]) for atom in self.atoms)

    def memory(self, period: int) -> int:
        """Bytes of RAM that it takes, whatever is measured.

        Args:
            period: ns between two of its samples, at least.
        """
        size = _MONITOR + len(self.atoms) * _ATOM + len(self.lines) * _LINE
        for op, _, first, _, _ in self.lines:
            if op in _REMEMBERING:
                # Results that wait for a window which begins later: on each side at most a run for
                # two samples.
                size += 2 * (first // period + 3) * _RUN
        return size


def difference(
    atom: Atom, units: Mapping[str, str], read: Callable[[str], Measured]
) -> tuple[Measured, bool]:
    """What a comparison asks to be positive, for the firmware.

    Args:
        atom: The comparison.
        units: UCUM code of each channel.
        read: Gives a channel's bounds.

    Returns:
        The expression, and whether 0 is not enough.

    Raises:
        MonitorError: It has channels of several units, or products of channels.
    """
    codes = sorted({units[name] for name in atom.channels})
    if len(codes) != 1:
        raise MonitorError(
            f"a node compares channels of one unit, and {atom} has {', '.join(codes) or 'none'}; "
            "let the cloud evaluate it",
            column=atom.column,
            value=str(atom),
        )
    unit = unit_of(codes[0])
    plain = all(isinstance(side, Channel | Constant) for side in (atom.left, atom.right))
    if unit.offset and not plain:
        raise _unsuited(atom)
    left, right = (_measured(side, unit, read) for side in (atom.left, atom.right))
    if not atom.comparison.upward:
        left, right = right, left
    return firmware.total(left, firmware.negated(right)), atom.comparison.strict


def _measured(  # noqa: PLR0911 - a line for each kind of expression
    node: Expression, unit: Unit, read: Callable[[str], Measured]
) -> Measured:
    if isinstance(node, Channel):
        if node.delay:
            raise _unsuited(node)
        return read(node.name)
    if isinstance(node, Constant):
        return firmware.number(*sides(_constant(node, unit)))
    if isinstance(node, Multiply | Divide):
        return _scaled(node, unit, read)
    parts = [_measured(part, unit, read) for part in node.parts if isinstance(part, Expression)]
    if isinstance(node, Negate):
        return firmware.negated(parts[0])
    if isinstance(node, Absolute):
        return firmware.absolute(parts[0])
    if isinstance(node, Add):
        return firmware.total(*parts)
    if isinstance(node, Subtract):
        return firmware.total(parts[0], firmware.negated(parts[1]))
    assert isinstance(node, Minimum | Maximum)  # noqa: S101 - there is no other
    return firmware.extreme(parts, least=isinstance(node, Minimum))


def _scaled(node: Multiply | Divide, unit: Unit, read: Callable[[str], Measured]) -> Measured:
    """A product with a pure number."""
    part, factor = node.left, node.right
    if isinstance(node, Multiply) and isinstance(part, Constant):
        part, factor = factor, part
    if not isinstance(factor, Constant) or factor.unit not in (None, "1") or factor.value == 0:
        raise _unsuited(node)
    value = factor.value if isinstance(node, Multiply) else Fraction(1) / factor.value
    return firmware.product(_measured(part, unit, read), *sides(value))


def _constant(node: Constant, unit: Unit) -> Fraction:
    own = unit if node.unit is None else known_unit(node.unit) or unit
    return (node.value * own.scale + own.offset - unit.offset) / unit.scale


def _unsuited(node: Atom | Expression) -> MonitorError:
    return MonitorError(
        f"a node adds channels, and multiplies them by numbers; let the cloud evaluate {node}",
        column=node.column,
        value=str(node),
    )
