"""How many cycles an instruction takes: every one that is executed, priced by Arm's own table.

Arm gives no cycles of the Cortex-M33. Those of the Cortex-M4, which has the same instructions and
as many stages, stand in its Technical Reference Manual (DDI 0439, table 3-1): one cycle, but 2 for
a load or store of which neighbours may hide one, 1 + N for several, 1 + P where it branches, P
being 1 to 3, and 2 to 12 for a division. Memory is assumed to have no wait states, as behind an
instruction cache.
"""

from __future__ import annotations

import re
from collections import Counter
from itertools import dropwhile, pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

from tests.robustness.cortex_m33.machine import traced

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from tests.robustness.cortex_m33.case import Case

_PIPELINE: Final = (1, 3)
"""P: cycles that a branch costs besides."""
_DIVISION: Final = (2, 12)
_COMMAND: Final = re.compile(r"^\s*([0-9a-f]+):\s+((?:[0-9a-f]{4} ?)+)\s+(\S+)\s*(.*)$")
_EXECUTED: Final = re.compile(r"\[[0-9a-f]+/([0-9a-f]+)/")
_BEGIN: Final = re.compile(r"^([0-9a-f]+) <run_case>:", re.MULTILINE)
_LISTED: Final = re.compile(r"\{([^}]*)\}")


class Instruction(NamedTuple):
    """One of the program.

    Attributes:
        size: Bytes.
        least: Cycles at least, where it does not branch.
        most: Cycles at most.
    """

    size: int
    least: int
    most: int


def cycles(cases: Sequence[Case]) -> list[tuple[float, float]]:
    """Mean cycles of an instruction of each of some cases, at least and at most."""
    with traced(cases) as (listing, log):
        program = dict(_program(listing))
        begin = next(int(found[1], 16) for found in _BEGIN.finditer(listing))
        steps = _steps(log, begin)
        return [_mean(program, next(steps)) for _ in cases]


def _steps(log: Path, begin: int) -> Iterator[Counter[tuple[int, int]]]:
    """Of each case, how often one instruction followed another one."""
    steps: Counter[tuple[int, int]] = Counter()
    with log.open() as lines:
        executed = (int(found[1], 16) for line in lines if (found := _EXECUTED.search(line)))
        for step in dropwhile(lambda step: step[1] != begin, pairwise(executed)):
            if step[1] == begin:
                if steps:
                    yield steps
                steps = Counter()
            else:
                steps[step] += 1
    yield steps


def _mean(program: dict[int, Instruction], steps: Counter[tuple[int, int]]) -> tuple[float, float]:
    least = most = count = 0
    for (address, following), times in steps.items():
        each = program[address]
        branches = following != address + each.size
        least += times * (each.least + branches * _PIPELINE[0])
        most += times * (each.most + branches * _PIPELINE[1])
        count += times
    return least / count, most / count


def _program(listing: str) -> Iterator[tuple[int, Instruction]]:
    for line in listing.splitlines():
        found = _COMMAND.match(line)
        if found:
            size = len(found[2].replace(" ", "")) // 2
            yield int(found[1], 16), Instruction(size, *_priced(found[3], found[4]))


def _priced(name: str, operands: str) -> tuple[int, int]:
    """Cycles where nothing branches."""
    name = name.split(".", maxsplit=1)[0]
    if name.startswith(("udiv", "sdiv")):
        return _DIVISION
    if re.match(r"(ldrd|strd)", name):
        return 3, 3
    if re.match(r"(push|pop|ldm|stm|vpush|vpop|vldm|vstm)", name):
        listed = _LISTED.search(operands)
        several = 1 + (_registers(listed[1]) if listed else 1)
        return several, several
    if re.match(r"v?(ldr|str)", name):
        return 1, 3 if name.startswith("v") else 2
    return (0, 1) if re.fullmatch(r"it[te]*", name) else (1, 2 if name.startswith("vmov") else 1)


def _registers(listed: str) -> int:
    """How many a list such as ``r4-r7, lr`` holds."""
    count = 0
    for each in listed.split(","):
        ends = [re.sub(r"\D", "", end) for end in each.split("-")]
        count += int(ends[1]) - int(ends[0]) + 1 if len(ends) > 1 else 1
    return count
