"""Cases of the inversions: each kind of sensor over all of its converter's range."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, cast

from eskin_sensor_node.firmware import inversion
from eskin_sensor_node.firmware.inversion.pad import UNUSED
from eskin_sensor_node.firmware.taxel.hygrometer import HygrometerTaxel
from eskin_sensor_node.firmware.taxel.pad import SLOTS
from eskin_sensor_node.firmware.taxel.thermometer import ThermometerTaxel
from eskin_sensor_node.machine.data_sheet import data_sheet

from tests.robustness.cortex_m33.case import Case, Recorder, reals
from tests.unit.sensor_node.designs import KINDS, taxel

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

    from eskin_sensor_node.firmware.calibration import Bounds

RUN: Final = 8
"""Samples of one call."""
_CODES: Final = 24
"""Codes of each kind, from one end of its converter to the other."""
_SLOPES: Final = ((1.4e-3, 1.6e-3), (-1.6e-3, -1.4e-3))


@dataclass(frozen=True, slots=True)
class Count:
    """Calls whose instructions make one figure of a price.

    Attributes:
        name: Of the price.
        cases: What is counted, one after the other.
        samples: Among which it is shared out.
        less: Calls whose instructions are taken off again.
    """

    name: str
    cases: list[Case]
    samples: int = RUN
    less: list[Case] = field(default_factory=list)


def inversions() -> Iterator[Count]:
    """Each chain's, a neighbour's, and what a pad does with the air."""
    for kind in KINDS:
        made = taxel(kind)
        last = (1 << made.adc_bits) - 1
        for k in range(_CODES + 1):
            yield Count(made.chain, _inverted(made, last * k // _CODES))
    yield from _neighbours()
    for sensor in (ThermometerTaxel, HygrometerTaxel):
        yield from _air(sensor)


def _recorder() -> tuple[Recorder, ModuleType]:
    recorder = Recorder(inversion)
    return recorder, cast("ModuleType", recorder)


def _inverted(made: Any, code: int) -> list[Case]:
    """What a taxel does with a run of one code at all its inputs."""
    recorder, functions = _recorder()
    firmware = made.firmware(data_sheet(made), functions)
    bounds = [reals(bytes(8 * RUN)) for _ in range(2 * len(firmware.quantities))]
    firmware.measure([array("i", [code] * RUN) for _ in firmware.inputs], RUN, bounds)
    firmware.separate(RUN, bounds, ())
    return recorder.cases


def _neighbours() -> Iterator[Count]:
    for felt in ((100.0, 300.0), (-50.0, -10.0), (1e4, 1e5), (0.0, 2e4), (float("-inf"), 5.0)):
        recorder, functions = _recorder()
        lows, highs = (reals([bound] * RUN) for bound in felt)
        total, least = reals([4e4] * RUN), reals([2e4] * RUN)
        functions.measure_neighbour(RUN, 2e4, lows, highs, total, least)
        yield Count("neighbour", recorder.cases)


def _air(kind: type[ThermometerTaxel | HygrometerTaxel]) -> Iterator[Count]:
    """Codes that are remembered, and codes that are new; over all of the converter's range."""
    name = "thermometer" if kind is ThermometerTaxel else "hygrometer"
    made = taxel(name)
    sheet, last = data_sheet(made), (1 << made.adc_bits) - 1
    for slope in _SLOPES:
        for k in range(_CODES + 1):
            code = last * k // _CODES

            def cases(
                n: int, *, known: bool, code: int = code, slope: Bounds = slope
            ) -> list[Case]:
                recorder, functions = _recorder()
                codes = array("i", [code if known else UNUSED] * SLOTS)
                memory = codes, reals([-1e-3] * SLOTS), reals([1e-3] * SLOTS)
                bounds = reals([1.0] * n), reals([1.0] * n)
                kind(sheet, functions).change(array("i", [code] * n), n, slope, memory, *bounds)
                return recorder.cases

            yield Count("remembered", cases(RUN, known=True))
            yield Count("new_" + name, cases(1, known=False), 1, cases(1, known=True))
