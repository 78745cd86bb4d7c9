"""Adaptive control within a frame: a touch that comes at once saturates no sample."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.firmware import inversion
from eskin_sensor_node.firmware.adaptation import Adaptation
from eskin_sensor_node.firmware.autoranging import MOST, Autoranging, Readings
from eskin_sensor_node.firmware.taxel.capacitive import CapacitiveTaxel
from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.machine.ledger import INTERRUPT_NS, REPEAT_NS
from eskin_sensor_node.machine.sampling import most_latency, most_repeats
from eskin_sensor_node.world.scenario.file import scenario_text
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from tests.unit.sensor_node.designs import SECOND, Bench, settings, table, taxel
from tests.unit.sensor_node.messages import assert_truth_is_inside, samples_of

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType

FINE: dict[str, Any] = {
    "adaptive": True,
    "gain_least": 0.25,
    "gain_most": 16.0,
    "gain_tolerance": 1e-3,
    "trimmer_steps": 200,
    "trimmer_tolerance": 1e-4,
}
AT = 0.93
"""When the skin is touched, in s: within a frame."""
TOUCH = """[[event]]
kind = "hold"
at = "{place}"
at_s = 0.93
duration_s = 2.0
rise_s = 1e-4
force_N = {force}
radius_m = {radius}
"""


SAMPLING = {"stretch_ms": 40.0}


def touched(folder: Path, scenario: str, design: str, functions: ModuleType, **touch: Any) -> Bench:
    """The pads of a packaged design, far too finely set when a touch covers all of them at once."""
    quiet = scenario_text(scenario).partition("[[event]]")[0]
    (folder / scenario).write_text(quiet + TOUCH.format(**touch))
    tables = settings(folder, design).model_dump(mode="json", by_alias=True)["taxel"]
    pads = [each for each in tables if each["kind"] == "pad"][:2]
    changes = {"scenario": str(folder / scenario), "sampling_Hz": 250.0} | FINE
    pads = [each | changes | {"thermometer": None, "hygrometer": None} for each in pads]
    given: dict[str, Any] = {"sampling": SAMPLING, "energy": {"on": False}}
    return Bench(folder, design, functions=functions, taxel=pads, **given)


def hand(folder: Path, functions: ModuleType) -> Bench:
    where = {"place": "t05", "force": 1000.0, "radius": 0.15}
    return touched(folder, "hand.toml", "hand", functions, **where)


def sole(folder: Path, functions: ModuleType) -> Bench:
    where = {"place": "t01", "force": 20_000.0, "radius": 0.15}
    return touched(folder, "walk.toml", "sole", functions, **where)


def palm(folder: Path, functions: ModuleType) -> Bench:
    given = table("touch", stimulus_Hz=1e-9, sampling_Hz=250.0, **FINE)
    bench = Bench(folder, "palm", functions=functions, taxel=(given,), sampling=SAMPLING)
    world: Any = bench.node.taxels[0].group.sensing.world
    before, world._most = world._most, world._least
    bench.run_to(0.92)
    world._least = world._most = before
    return bench


DESIGNS = {"hand": hand, "sole": sole, "palm": palm}


def lived(bench: Bench) -> tuple[int, int]:
    """How many samples around the touch were unbounded, and how many conversions were repeated."""
    bench.run_to(AT - 0.05)
    repeated, each = 0, min(taxel.next.end - taxel.next.start for taxel in bench.node.taxels)
    while bench.ticks < (AT + 0.3) * SECOND:
        bench.run_to((bench.ticks + each) / SECOND)
        repeated += sum(taxel.reader.repeats.conversions for taxel in bench.node.taxels)
    found = samples_of(bench)
    assert_truth_is_inside(found)
    return sum(int(np.sum(~each.tube.values.is_common_interval)) for each in found), repeated


@pytest.mark.parametrize("design", DESIGNS)
def test_sudden_touch_of_all_saturates_no_sample(design: str, tmp_path: Path) -> None:
    bench = DESIGNS[design](tmp_path, compiled_inversion())
    unbounded, repeated = lived(bench)
    bench.close()
    assert unbounded == 0
    assert repeated > 0


@pytest.mark.parametrize("design", DESIGNS)
def test_without_repeats_it_does(
    design: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin_sensor_node.node.node.most_repeats", lambda *_: 0)
    bench = DESIGNS[design](tmp_path, compiled_inversion())
    unbounded, repeated = lived(bench)
    bench.close()
    assert unbounded > 0
    assert repeated == 0


def test_compiled_firmware_writes_the_same(tmp_path: Path) -> None:
    said = []
    for number, functions in enumerate((inversion, compiled_inversion())):
        (tmp_path / str(number)).mkdir()
        bench = hand(tmp_path / str(number), functions)
        repeated = lived(bench)[1]
        said.append((repeated, list(bench.bodies())))
        bench.close()
    assert said[0] == said[1]
    assert said[0][0] > 0


def test_repeats_are_paid_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spent = []
    for name, most in (("without", 0), ("with", MOST)):
        monkeypatch.setattr("eskin_sensor_node.node.node.most_repeats", lambda *_, most=most: most)
        (tmp_path / name).mkdir()
        bench = palm(tmp_path / name, inversion)
        bench.node.machine.ledger.take(bench.ticks)
        bench.run_to(0.96)
        (each,) = bench.node.taxels
        spent.append((bench.node.machine.ledger.take(bench.ticks), each.reader.repeats))
        bench.close()
    (before, none), (after, repeats) = spent
    assert (none.samples, repeats.samples) == (0, 10)
    assert 10 <= repeats.conversions == after.conversions - before.conversions <= 10 * MOST
    assert after.wakes - before.wakes == repeats.samples
    awake = repeats.conversions * REPEAT_NS + repeats.samples * INTERRUPT_NS
    assert before.asleep - after.asleep > awake
    assert after.cycles > before.cycles


def test_samples_that_come_too_fast_are_not_repeated(tmp_path: Path) -> None:
    forearm, many = settings(tmp_path, "forearm"), settings(tmp_path, "hand")
    assert [most_repeats(forearm, each) for each in forearm.taxel] == [MOST, 0]
    assert {most_repeats(many, each) for each in many.taxel} == {MOST}
    # All may saturate at once, and the last of them is still served in time.
    inputs = len(many.taxel)
    tight = many.taxel[0].model_copy(update={"sampling": 1.0})
    for repeats in (1, 2):
        period = most_latency(inputs) + INTERRUPT_NS + repeats * inputs * REPEAT_NS
        for spare, expected in ((0, repeats), (-1, repeats - 1)):
            fast = tight.model_copy(update={"sampling": SECOND / (period + spare)})
            assert most_repeats(many, fast) == expected


CHANGES = st.fixed_dictionaries(
    {
        "gain_least": st.sampled_from([0.125, 0.3, 1.0]),
        "gain_tolerance": st.sampled_from([0.0, 1e-2]),
        "trimmer_steps": st.sampled_from([0, 3, 500]),
        "trimmer_step": st.sampled_from([0.01, 0.3]),
        "trimmer_tolerance": st.sampled_from([0.0, 1e-3]),
        "adc_gain_error": st.sampled_from([0.0, 1e-3]),
        "adc_offset_error": st.sampled_from([0.0, 2.0]),
        "adc_nonlinearity": st.sampled_from([0.0, 2.0]),
        "adc_min_A": st.sampled_from([0.0, 3e-4]),
        "adc_bits": st.sampled_from([7, 12]),
    }
)


@hypothesis_settings(deadline=None, max_examples=60)
@given(
    CHANGES,
    st.sampled_from([0.1, 1.0, 8.0]),
    st.floats(-1.0, 1.0),
    st.sampled_from([1, -1]),
    st.floats(0.0, 1.0),
    st.integers(0, 99),
)
def test_what_lies_beyond_an_end_is_bounded_by_the_range_that_goes_on_there(
    changes: dict[str, Any], gain: float, share: float, side: int, inside: float, seed: int
) -> None:
    design = taxel("capacitive", **changes)
    sheet = data_sheet(design)
    made, chosen = CapacitiveTaxel(sheet), Adaptation(sheet)
    chosen.gain, chosen.trim = gain, int(share * design.trimmer_steps)
    ranging = Autoranging(made, chosen, MOST)
    made.adjust(chosen.gain, chosen.trim)
    converter = Converter(design, ColumnGenerator(seed, 0))
    converter.adjust(chosen.gain, chosen.trim)
    beyond = ranging._ranges(side)
    assume(beyond)
    assert len(beyond) <= MOST
    assert all(each >= min(design.gain_least, gain) for each, _ in beyond)
    begin, end = (chosen._end(side, *each) for each in ((chosen.gain, chosen.trim), beyond[-1]))
    assert side * end > side * begin
    # As far inside of the last range as its errors reach.
    margin = chosen._overlap(beyond[-1][0], beyond[-1], end) / beyond[-1][0]
    held = np.array([begin + inside * (end - side * margin - begin)])
    assume(side * (end - side * margin - begin) > 0.0)
    readings = Readings([converter.convert(held)[0].tolist()], [[0]])
    if readings.codes[0][0] in {0, converter.last}:
        ranging.repeat(readings, 0, 0, lambda *by: int(converter.repeat(held, *by)[0, 0]))
    bounds = [[0.0] for _ in range(4)]
    ranging.measure(readings, 1, bounds)
    lo, hi = bounds[2][0], bounds[3][0]
    assert lo <= held[0] <= hi
    assert math.isfinite(lo)
    assert math.isfinite(hi)


def test_end_of_the_last_range_stays() -> None:
    sheet = data_sheet(taxel("capacitive", gain_least=1.0))
    made = CapacitiveTaxel(sheet)
    readings = Readings([[4095]], [[0]])
    Autoranging(made, Adaptation(sheet), MOST).repeat(
        readings, 0, 0, lambda *_: pytest.fail("asked")
    )
    assert (readings.codes, readings.ranges) == ([[4095]], [[0]])
