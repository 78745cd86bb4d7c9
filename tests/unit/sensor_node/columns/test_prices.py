"""Prices of a processor with binary64 in hardware enclose the firmware's own operations."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar

import pytest
from eskin_sensor_node.firmware import inversion
from eskin_sensor_node.firmware.taxel.pad import PadTaxel
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.machine.prices import CORTEX_A53, PRICES, PROCESSORS, stretch

from tests.unit.sensor_node.designs import settings

if TYPE_CHECKING:
    from pathlib import Path

MOST = {"add": 6, "product": 6, "sign": 6, "division": 33, "comparison": 8, "access": 4}
"""Cycles of an operation whose result the next one waits for; a comparison with its branch."""
LEAST = {"add": 0.5, "product": 0.5, "sign": 0.5, "division": 29, "comparison": 1.0, "access": 0.5}
KINDS = {
    "add": ("__add__", "__radd__", "__sub__", "__rsub__"),
    "product": ("__mul__", "__rmul__"),
    "sign": ("__abs__", "__neg__"),
    "division": ("__truediv__", "__rtruediv__"),
    "comparison": ("__lt__", "__le__", "__gt__", "__ge__", "__eq__", "__ne__"),
}


class Counted(float):
    """A number that counts what is done with it."""

    done: ClassVar[Counter[str]] = Counter()
    __hash__ = float.__hash__


def _counting(name: str, kind: str) -> Any:
    own = getattr(float, name)

    def operate(self: float, *others: float) -> Any:
        Counted.done[kind] += 1
        return counted(own(self, *map(float, others)))

    return operate


for each, names in KINDS.items():
    for name in names:
        setattr(Counted, name, _counting(name, each))


def counted(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(map(counted, value))
    return Counted(value) if isinstance(value, float) else value


class Cells(list[Any]):
    """A buffer that counts accesses."""

    def __getitem__(self, place: Any) -> Any:
        Counted.done["access"] += 1
        return super().__getitem__(place)

    def __setitem__(self, place: Any, value: Any) -> None:
        Counted.done["access"] += 1
        super().__setitem__(place, counted(float(value)))


def operations(folder: Path, code: int, around: int) -> Counter[str]:
    """What the firmware does for one sample of a pad whose neighbours are measured."""
    skin = settings(folder, "small-hand").skin
    taxel = PadTaxel(data_sheet(skin.taxel, {}), inversion)
    taxel.surround(4)
    for name, value in vars(taxel).items():
        setattr(taxel, name, counted(value))
    bounds = [Cells([Counted(1.0)]) for _ in range(10)]
    neighbours = [(Cells([Counted(-1e3)]), Cells([Counted(1e3)])) for _ in range(around)]
    Counted.done.clear()
    taxel.measure([Cells([code])], 1, bounds)
    taxel.separate(1, bounds, neighbours)
    return Counter(Counted.done)


def cycles(done: Counter[str], each: dict[str, Any]) -> float:
    return float(sum(each[kind] * count for kind, count in done.items()))


@pytest.mark.parametrize("code", [0, 1, 2600, 3000, 3400, 4094, 4095])
def test_a_sample_of_a_pad_takes_what_is_priced(code: int, tmp_path: Path) -> None:
    alone, surrounded = operations(tmp_path, code, 0), operations(tmp_path, code, 4)
    price = CORTEX_A53["pad"]
    assert cycles(alone, MOST) <= price.most
    if 0 < code < 4095:
        assert price.least <= cycles(alone, LEAST)
    assert cycles(surrounded, MOST) <= price.most + 4 * CORTEX_A53["neighbour"].most


def test_hardware_is_never_dearer_than_software() -> None:
    for name, price in CORTEX_A53.items():
        assert price.most <= PRICES[name].most
        assert price.least <= PRICES[name].least


def test_a_stretch_costs_in_proportion_to_its_samples() -> None:
    def total(processor: str, taxels: int, rows: int) -> int:
        given = {"neighbours": 4, "along": ["thermometer"], "sizes": [1000]}
        return stretch(processor, "pad", taxels=taxels, rows=rows, **given).total.most  # type: ignore[arg-type]

    for processor in PROCESSORS:
        one, more, longer = (total(processor, *of) for of in ((100, 5), (200, 5), (100, 10)))
        assert one < more < 2 * one
        assert one < longer < 2 * one
    assert total("cortex-a53", 100, 5) < total("cortex-m33", 100, 5)
