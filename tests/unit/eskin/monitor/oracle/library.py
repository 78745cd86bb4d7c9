"""Asks the library what the oracle knows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.interval import Verdict
from eskin.monitor import Signal, evaluate, parse
from tests.unit.eskin.monitor.oracle.draw import UNIT
from tests.unit.eskin.monitor.oracle.formulas import write

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.monitor import Verdicts
    from tests.unit.eskin.monitor.oracle.draw import Scene
    from tests.unit.eskin.monitor.oracle.signals import Samples

SAID: Final = {
    (True, True): Verdict.CERTAIN,
    (False, True): Verdict.POSSIBLE,
    (False, False): Verdict.IMPOSSIBLE,
}
"""The verdict, by whether a formula certainly and possibly holds."""


def signal(samples: Samples) -> Signal:
    """The library's form of what is known of a channel."""
    factor = 1000 if samples.kilo else 1
    return Signal(
        np.array(samples.earliest, dtype=np.int64),
        np.array(samples.latest, dtype=np.int64),
        np.array([float(value / factor) for value in samples.lo]),
        np.array([float(value / factor) for value in samples.hi]),
        np.full(len(samples), samples.period, dtype=np.int64),
        np.array(samples.gap, dtype=bool),
        unit=("k" if samples.kilo else "") + UNIT,
        until=samples.until,
    )


def signals(known: Mapping[str, Samples]) -> dict[str, Signal]:
    return {name: signal(samples) for name, samples in known.items()}


def ask(scene: Scene) -> Verdicts:
    """The library's verdicts on a scene."""
    return evaluate(parse(write(scene.formula)), signals(scene.known))
