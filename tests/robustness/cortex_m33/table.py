"""The table of prices: instructions of each operation, at least and at most."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from math import ceil, floor
from typing import TYPE_CHECKING, Final

from tests.robustness.cortex_m33.arithmetic import arithmetic
from tests.robustness.cortex_m33.case import Case
from tests.robustness.cortex_m33.channels import channels
from tests.robustness.cortex_m33.cycles import cycles
from tests.robustness.cortex_m33.inversions import inversions
from tests.robustness.cortex_m33.machine import FLAGS, ROOT, MachineError, run, versions
from tests.robustness.cortex_m33.monitors import monitors

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tests.robustness.cortex_m33.inversions import Count

PATH: Final = ROOT / "sensor_node" / "eskin_sensor_node" / "machine" / "instructions.toml"
TOLERANCE: Final = 0.02
"""Relative: what another release of the compiler may change before a person must look."""
_PLACES: Final = 1
_LOOP: Final = (1, 1001, 100_001)
"""Rounds of two instructions each, of which the machine's count is known."""
_HEAD: Final = """\
# What the firmware's inner operations take in C on a Cortex-M33 without binary64, at least and at
# most over the cases of `tests.robustness.cortex_m33`, which writes this file (--write) and checks
# it. Instructions are counted; an instruction's cycles are bounded. docs/node.md states how.
"""

Prices = dict[str, tuple[int, int]]
Rates = dict[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Table:
    """What was counted.

    Attributes:
        build: What built and ran it.
        prices: Instructions of each operation, at least and at most.
        rates: Cycles of an instruction of each operation, on the mean, at least and at most.
    """

    build: dict[str, str]
    prices: Prices
    rates: Rates

    @classmethod
    def read(cls) -> Table:
        """The committed one."""
        found = tomllib.loads(PATH.read_text())
        prices = {name: (low, high) for name, (low, high) in found["instructions"].items()}
        rates = {name: (low, high) for name, (low, high) in found["cycles"].items()}
        return cls(found["build"], prices, rates)

    def write(self) -> None:
        """Commit to it."""
        build = "".join(f'{name} = "{value}"\n' for name, value in self.build.items())
        prices, rates = (
            "".join(f"{name} = [{low}, {high}]\n" for name, (low, high) in part.items())
            for part in (self.prices, self.rates)
        )
        of_one = "# Of one instruction, on the mean.\n"
        text = f"{_HEAD}\n[build]\n{build}\n[instructions]\n{prices}\n{of_one}[cycles]\n{rates}"
        PATH.write_text(text)

    def differences(self, other: Table) -> list[str]:
        """Prices and rates that differ by more than the tolerance, or that only one has."""
        return _differences(self.prices, other.prices, 1.0) + _differences(
            self.rates, other.rates, 10.0**-_PLACES
        )


def count() -> Table:
    """Build, run, and count anew.

    Raises:
        MachineError: The program did not run, does not count its loop right, or gives other bits
            than the firmware's Python.
    """
    counts = [*arithmetic(), *inversions(), *channels(), *monitors()]
    own = [Case.of("nothing"), *(Case.of("loop", rounds) for rounds in _LOOP)]
    cases = own + [case for each in counts for case in (*each.cases, *each.less)]
    results = run(cases)
    for case, result in zip(cases, results, strict=True):
        if result.arrays != b"".join(case.expected):
            raise MachineError(f"{case.name} gives other bits than Python: {case.items}")
    looks, *loops = (result.instructions for result in results[: len(own)])
    if [each - loops[0] for each in loops[1:]] != [2 * (n - _LOOP[0]) for n in _LOOP[1:]]:
        raise MachineError(f"loops of {_LOOP} rounds of two instructions count {loops}")
    taken = {id(case): r.instructions - looks for case, r in zip(cases, results, strict=True)}
    build = versions() | {"flags": FLAGS}
    return Table(build, _prices(counts, taken), _rates(counts))


def _rates(counts: Sequence[Count]) -> Rates:
    """Of the case in the middle of each operation's, rounded outward."""
    cases = {}
    for name in dict.fromkeys(each.name for each in counts):
        own = [each for each in counts if each.name == name]
        cases[name] = own[len(own) // 2].cases[-1]
    one = 10**_PLACES
    return {
        name: (floor(least * one) / one, ceil(most * one) / one)
        for name, (least, most) in zip(cases, cycles(list(cases.values())), strict=True)
    }


def _prices(counts: Sequence[Count], taken: Mapping[int, int]) -> Prices:
    found: Prices = {}
    for each in counts:
        total = sum(taken[id(case)] for case in each.cases)
        total -= sum(taken[id(case)] for case in each.less)
        low, high = floor(total / each.samples), ceil(total / each.samples)
        least, most = found.get(each.name, (low, high))
        found[each.name] = min(least, low), max(most, high)
    return found


def _differences(
    ones: Mapping[str, tuple[float, float]], others: Mapping[str, tuple[float, float]], step: float
) -> list[str]:
    found = []
    for name in sorted(ones.keys() | others.keys()):
        one, other = ones.get(name), others.get(name)
        if one is None or other is None or _far(one, other, step):
            found.append(f"{name}: {one} is found, {other} is expected")
    return found


def _far(one: tuple[float, float], other: tuple[float, float], step: float) -> bool:
    return any(
        abs(a - b) > max(1.001 * step, TOLERANCE * a) for a, b in zip(one, other, strict=True)
    )
