"""The firmware's arithmetic gives the same bits whether interpreted or compiled."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING

import pytest
from eskin_sensor_node.firmware import inversion
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.data_sheet import data_sheet
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.unit.sensor_node.designs import KINDS, Bench, taxel

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType

CODES = st.lists(st.integers(0, 4095), min_size=1, max_size=50)


def measured(kind: str, codes: list[int], functions: ModuleType, inl: float) -> list[bytes]:
    design = taxel(kind, adc_nonlinearity=inl)
    calibrated = design.firmware(data_sheet(design), functions)
    given_codes = [array("q", codes) for _ in calibrated.inputs]
    bounds = [array("d", bytes(8 * len(codes))) for _ in range(2 * len(calibrated.quantities))]
    calibrated.measure(given_codes, len(codes), bounds)
    return [each.tobytes() for each in bounds]


@pytest.mark.parametrize("kind", KINDS)
def test_compiled_gives_the_same_bits(kind: str) -> None:
    @settings(deadline=None)
    @given(CODES, st.sampled_from([0.0, 0.5, 3.0]))
    def check(codes: list[int], inl: float) -> None:
        plain = measured(kind, [0, *codes, 4095], inversion, inl)
        assert measured(kind, [0, *codes, 4095], compiled_inversion(), inl) == plain

    check()


@pytest.mark.parametrize(
    ("profile", "seconds"),
    [
        ("fingertip", 0.6),
        ("palm", 0.6),
        ("forearm", 0.6),
        ("hand", 0.6),
        ("sole", 10.0),
        ("sock", 10.0),
    ],
)
def test_compiled_node_equals_the_interpreted_one_to_the_byte(
    profile: str, seconds: float, tmp_path: Path
) -> None:
    plain = Bench(tmp_path / "plain", profile)
    fast = Bench(tmp_path / "fast", profile, functions=compiled_inversion())
    for bench in (plain, fast):
        bench.run_to(seconds)
        bench.node.finish()
    said = list(plain.bodies())
    assert len(said) > 4
    assert list(fast.bodies()) == said
    plain.close()
    fast.close()
