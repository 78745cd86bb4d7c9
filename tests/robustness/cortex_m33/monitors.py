"""Cases of monitors: formulas of each operator, over codes that come and go."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING, Final

import numpy as np
from eskin_sensor_node.firmware import monitor as engine
from eskin_sensor_node.firmware.reflex import Reflex

from eskin.monitor import Atom, parse
from eskin.monitor.program import instructions
from tests.robustness.cortex_m33.case import Case
from tests.robustness.cortex_m33.inversions import Count

if TYPE_CHECKING:
    from collections.abc import Iterator

STEPS: Final = 200
_DT: Final = 1_000_000
_DRIFT: Final = 20_000
_MISSING: Final = -1
_FORMULAS: Final = (
    "p > 0",
    "p > 0 and q > 0",
    "count(p > 0, q > 0, r > 0) >= 2",
    "not (p > 0 or q > 0)",
    "count(p > 0, q > 0) < 2",
    "once[0,20ms] p > 0",
    "historically[0,20ms] p > 0",
    "once[5ms,20ms] p > 0",
    "p > 0 since[0,20ms] q > 0",
    "p > 0 since[3ms,20ms] q > 0",
    "rise(p > 0)",
    "fall(p > 0)",
    "p > 0 implies once[0,20ms] q > 0",
    "historically[0,50ms](p > 0 implies once[0,20ms] q > 0)",
    "rise(p > 0) and once[10ms,40ms] rise(p > 0) and historically[0,5ms] q > 0",
)


def monitors() -> Iterator[Count]:
    """What a monitor takes for each run that its instructions take."""
    for formula in _FORMULAS:
        yield from (Count("monitor_run", *_case(formula, seed)) for seed in (1, 2))


def _case(text: str, seed: int) -> tuple[list[Case], int]:
    random = np.random.default_rng(seed)
    formula = parse(text)
    atoms = list(dict.fromkeys(node for node in formula.walk() if isinstance(node, Atom)))
    lines = instructions(formula, {atom: k for k, atom in enumerate(atoms)})
    # Codes stay for a while; some samples are missing.
    stays = random.random((STEPS, len(atoms))) < (0.2 if seed == 1 else 0.9)
    codes = random.integers(0, 8, (STEPS, len(atoms)))
    for k in range(1, STEPS):
        codes[k] = np.where(stays[k], codes[k], codes[k - 1])
    codes = np.where(random.random(codes.shape) < (0.02 if seed == 1 else 0.1), _MISSING, codes)
    codes[:, 0] = np.maximum(codes[:, 0], 0)
    certain, possible = (5, 7), (3, 7)
    sources = [engine.Source(_DT, _DRIFT) for _ in atoms]
    made = [engine.Threshold(source, 0, derived=False) for source in sources]
    for each in made:
        each.set(certain, possible)
    monitor = engine.Monitor(lines, made, 0, _DRIFT)
    reflex = Reflex("", monitor, engine.CERTAIN, "", 1.0)
    verdicts = []
    for k, row in enumerate(codes.tolist()):
        for source, code in zip(sources, row, strict=True):
            source.fresh = False
            if code != _MISSING:
                source.take(k * _DT, [[code]])
        reflex.compare(k * _DT)
        verdicts.append(monitor.step(k * _DT))
    given = (
        _integers([number for line in lines for number in line]),
        _integers([number for _ in made for number in (*certain, *possible, _DT)]),
        _DRIFT,
        _DT,
        _integers(codes.ravel().tolist()),
        _integers([0] * STEPS),
    )
    arrays = [each for each in given if not isinstance(each, int)]
    case = Case.of("monitor", *given, after=[*arrays[:-1], _integers(verdicts)])
    return [case], monitor.work


def _integers(values: list[int]) -> array[int]:
    return array("i", values)
