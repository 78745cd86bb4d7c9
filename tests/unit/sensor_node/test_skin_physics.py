"""Pads and coils of a skin: what is true of them, their faults, and what can be stated of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.firmware.selftest import CERTAIN, SelfTest
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.kinds.pad import PadSection, PadWorld
from eskin_sensor_node.kinds.registry import build_frontend, build_world
from eskin_sensor_node.machine.inversion import Inversion
from eskin_sensor_node.tools.dataset.pad_inversion import PadInversion
from eskin_sensor_node.world.scenario import Stage, read_scenario
from eskin_sensor_node.world.skin import unmix
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from eskin.interval import Interval
from eskin.models import capacitance, proximity_at
from tests.unit.sensor_node.designs import taxel
from tests.unit.sensor_node.scenario.scripts import HEAD, TAP, write

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.kinds.settings import TaxelSection

    from eskin.interval import Floats

TIMES = np.arange(2000) / 100.0
INSTANTS = np.rint(TIMES * 1e9).astype(np.int64)
EXACT = {
    f"{part}_tolerance": 0.0
    for part in (
        *("plate_area", "plate_distance", "relative_permittivity", "elasticity"),
        *("permittivity_per_K", "permittivity_per_percent"),
    )
}

KNOWN = {
    **EXACT,
    **{f"{part}_tolerance": 0.0 for part in ("resistance", "reference", "transconductance")},
    **{f"permittivity_per_{unit}": 0.0 for unit in ("K", "percent")},
    "noise": {"kind": "uniform", "bound": 0.0},
}
"""A pad of which everything is known, but what its neighbours hand on."""


def pad_of(scene: str, place: str, **changes: Any) -> PadSection:
    made = taxel("pad", scenario=scene, place=place, **changes)
    assert isinstance(made, PadSection)
    return made


def truth(design: TaxelSection, times: Floats = TIMES) -> dict[str, Floats]:
    random = ColumnGenerator(1, 0)
    signals = build_world(design, random).signals(times, random)
    return {name: values[0] for name, values in signals.truth.items()}


def test_pad_is_the_parallel_plates_of_its_covered_and_its_free_part(tmp_path: Path) -> None:
    scene = write(tmp_path, HEAD + TAP)
    true = truth(taxel("pad", **EXACT, scenario=scene, place="t05", plate_area_m2=9e-5))
    part = {"relative_permittivity": 3.0}
    covered = true["contact_area"]
    pressed = capacitance(area=covered + 1e-30, distance=true["contact_distance"], **part)
    free = capacitance(area=9e-5 - covered, distance=1e-3, **part)
    both = pressed + free
    assert true["capacitance"] == pytest.approx(both.mid, rel=1e-9)
    mean = capacitance(area=9e-5, distance=true["plate_distance"], **part)
    assert true["capacitance"] == pytest.approx(mean.mid, rel=1e-9)
    assert true["contact_distance"].min() < true["plate_distance"].min() < 0.95e-3
    assert np.all(true["contact_distance"][covered == 0.0] == 1e-3)


def test_distance_under_a_contact_halves_where_the_pressure_is_the_elasticity(
    tmp_path: Path,
) -> None:
    pressure = 1.0 / (np.pi * 4e-3**2)  # of the tap, in Pa
    scene = write(tmp_path, HEAD + TAP)
    design = taxel(
        "pad", **EXACT, scenario=scene, place="t05", plate_area_m2=9e-5, elasticity_Pa=pressure
    )
    assert truth(design, np.array([1.1]))["contact_distance"] == pytest.approx([0.5e-3])


def test_permittivity_follows_temperature_and_humidity(tmp_path: Path) -> None:
    air = "[ambient]\ntemperature_Cel = [[0.0, 30.0]]\nhumidity_percent = [[0.0, 70.0]]\n"
    changed = [
        truth(
            taxel("pad", **EXACT, scenario=write(tmp_path, text), place="t05", plate_area_m2=9e-5),
            np.array([0.0]),
        )["capacitance"][0]
        for text in (HEAD, HEAD + air)
    ]
    assert changed[1] / changed[0] == pytest.approx(1.0 + 10 * 1e-3 + 20 * 5e-4)


def test_coil_follows_eq_11_and_its_eddy_currents_the_reflected_impedance() -> None:
    parts = ("inductance", "inductance_change", "damping", "coil_resistance", "excitation")
    still = {f"{part}_tolerance": 0.0 for part in parts}
    true = truth(taxel("coil", **still))
    model = proximity_at(
        true["distance"],
        base_inductance=10e-3,
        inductance_change=5e-3,
        damping=10.0,
        capacitance=1e-6,
    )
    assert np.all(model.inductance.contains(true["inductance"]))
    nearest = true["distance"].argmin()
    assert true["distance"][nearest] < 0.03
    fall = 5e-3 * np.exp(-10.0 * true["distance"][nearest])
    omega = 2e3 * np.pi
    # A loop of any self-inductance with quality 10, coupled so that the inductance falls by this.
    loop = 1e-6
    mutual = np.sqrt(fall * loop * (1 + 10.0**2) / 10.0**2)
    reflected = (omega * mutual) ** 2 / (omega * loop / 10.0 + 1j * omega * loop)
    before = 5.0 + 1j * omega * 10e-3
    after = before + reflected
    assert true["eddy_amplitude"][nearest] == pytest.approx(abs(before / after))
    assert true["eddy_phase"][nearest] == pytest.approx(np.angle(before / after))
    assert true["eddy_amplitude"][0] == pytest.approx(1.0, abs=1e-3)


FAULT = '\n[[fault]]\ntaxel = "t05"\nkind = "{}"\nat_s = {}\n'


@pytest.mark.parametrize(("kind", "quantity"), [("pad", "capacitance"), ("coil", "inductance")])
def test_stuck_taxel_keeps_the_value_that_it_had(kind: str, quantity: str, tmp_path: Path) -> None:
    metal = (
        '[[event]]\nkind = "approach"\nat = "t05"\nat_s = 1.0\nduration_s = 2.0\nnear_m = 1e-2\n'
    )
    changes: dict[str, Any] = {"plate_area_m2": 9e-5} if kind == "pad" else {}
    well, broken = (
        truth(taxel(kind, scenario=write(tmp_path, text), place="t05", **changes))[quantity]
        for text in (HEAD + TAP + metal, HEAD + TAP + metal + FAULT.format("stuck", 1.1))
    )
    after = TIMES >= 1.1
    assert np.array_equal(well[~after], broken[~after])
    assert np.all(broken[after] == well[110])
    assert well[110] != well[-1]


@pytest.mark.parametrize(("kind", "quantity"), [("pad", "capacitance"), ("coil", "inductance")])
def test_dead_taxel_saturates_and_its_intervals_still_hold(
    kind: str, quantity: str, tmp_path: Path
) -> None:
    changes: dict[str, Any] = (
        {"plate_area_m2": 9e-5, "resistance_ohm": 4e4} if kind == "pad" else {}
    )
    scene = write(tmp_path, HEAD + FAULT.format("dead", 3.0))
    design = taxel(kind, scenario=scene, place="t05", **changes)
    random = ColumnGenerator(1, 0)
    world, frontend = build_world(design, random), build_frontend(design, random)
    random.begin(1, INSTANTS)
    signals = world.signals(TIMES, random)
    values = Inversion(design).measure(frontend.digitise(signals.sensed, random).codes)[quantity]
    assert np.array_equal(~values.is_common_interval[0], TIMES >= 3.0)
    assert np.all(values.contains(signals.truth[quantity]))


REFUSALS: dict[str, tuple[dict[str, Any], str]] = {
    "place": ({"place": "t21"}, "the skin of hand.toml has t00 to t20"),
    "file": ({"scenario": "none.toml"}, "none.toml: file: it cannot be read"),
    "pressure": ({"pressure_max_Pa": 1e3}, "the scenario's contacts press with up to 1.79e+04 Pa"),
    "room": ({"plate_area_m2": 5e-4}, "is more than a taxel of the scenario's skin has, 0.0004"),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_pad_that_does_not_fit_its_scenario_is_refused(name: str) -> None:
    changes, said = REFUSALS[name]
    with pytest.raises(ValidationError, match=said.replace("+", r"\+")):
        taxel("pad", **changes)


@st.composite
def pads(draw: st.DrawFn) -> PadSection:
    changes: dict[str, Any] = {name: draw(st.floats(0.0, 0.02)) for name in EXACT}
    changes["permittivity_per_K"] = draw(st.floats(-2e-3, 2e-3))
    made = taxel("pad", **changes, place=draw(st.sampled_from(["t05", "t06", "t10", "t15"])))
    assert isinstance(made, PadSection)
    return made


@settings(
    max_examples=40, deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow]
)
@given(pads(), st.integers(0, 2**32), st.booleans())
def test_felt_pressure_and_distances_hold_the_truth(
    design: PadSection,
    seed: int,
    thin: bool,  # noqa: FBT001 - hypothesis gives it
) -> None:
    random = np.random.default_rng(seed)
    script = read_scenario("hand.toml")
    stage = Stage(script, [design.place], seed=seed)
    pad = PadWorld(design, ColumnGenerator(seed, 0), [design.place], stage=stage)
    true, stimulus = pad.truth(np.sort(random.uniform(0.0, 20.0, 500)))
    inversion = PadInversion(design)
    error = 0.0 if thin else 1e-3
    measured = Interval.relative(true["capacitance"], error)
    temperature = Interval.around(stimulus.temperature, error)
    distance = inversion.plate_distance(measured, temperature, Interval(stimulus.humidity))
    assert np.all(distance.contains(true["plate_distance"]))
    assert np.all(inversion.stated_distance.contains(true["plate_distance"]))
    assert np.all(inversion.felt(distance).contains(stimulus.felt))
    own = Interval.relative(true["pressure"], error)
    for quantity, values in inversion.quantities(own).items():
        assert np.all(values.contains(true[quantity])), quantity


def test_crosstalk_of_unknown_neighbours_is_taken_in() -> None:
    design = pad_of("hand.toml", "t06", **KNOWN, adc_bits=20)
    random = ColumnGenerator(1, 0)
    world, frontend = build_world(design, random), build_frontend(design, random)
    random.begin(1, INSTANTS)
    signals = world.signals(TIMES, random)
    digitised = frontend.digitise(signals.sensed, random)
    for crosstalk, holds in ((0.1, True), (0.0, False)):
        believed = design.model_copy(update={"crosstalk": crosstalk})
        stated = Inversion(believed).measure(digitised.codes)["pressure"]
        assert np.all(stated.contains(signals.truth["pressure"])) == holds


def test_touch_is_certain_on_a_skin_of_packaged_pads() -> None:
    script = read_scenario("hand.toml")
    stage = Stage(script)
    design, random = pad_of("hand.toml", "t05"), ColumnGenerator(3, np.arange(len(stage.skin)))
    world = PadWorld(design, random, stage.skin.names, stage=stage)
    frontend, inversion = build_frontend(design, random), PadInversion(design)
    random.begin(1, INSTANTS)
    true, stimulus = world.truth(TIMES)
    digitised = frontend.digitise({"capacitance": true["capacitance"]}, random)
    measured = Inversion(design).measure(digitised.codes)["capacitance"]
    air = Interval(stimulus.temperature), Interval(stimulus.humidity)
    felt = inversion.felt(inversion.plate_distance(measured, *air))
    own = unmix(felt, stage.skin.neighbours, bound=0.1, most=5e4)
    assert np.all(own.contains(true["pressure"]))
    stated = inversion.quantities(own)
    assert stated["pressure"].inf[5].max() > 0.8 * true["pressure"][5].max()
    assert stated["contact_area"].inf[5].max() > 0.15 * true["contact_area"][5].max()
    assert stated["contact_distance"].sup[5].min() < 0.96e-3
    # Fingers have no neighbours that are pressed: what touches nothing is never certainly pressed.
    assert not np.any(stated["pressure"].inf[20] > 0.0)


def test_faults_of_a_skin_are_found_from_its_intervals(tmp_path: Path) -> None:
    press = TAP.replace("tap", "press").replace("4e-3", "2.5e-2").replace("1.0\nr", "20.0\nr")
    press = press.replace("duration_s = 0.2", "duration_s = 2.0")
    faults = FAULT.format("stuck", 0.5) + FAULT.format("dead", 0.0).replace("t05", "t11")
    scene = write(tmp_path, HEAD + press + faults)
    script = read_scenario(scene)
    skin = script.skin.build()
    design = pad_of(scene, "t05", plate_area_m2=9e-5, resistance_ohm=4e4)
    random = ColumnGenerator(1, np.arange(len(skin)))
    world, frontend = build_world(design, random, skin.names), build_frontend(design, random)
    random.begin(1, INSTANTS[:400])
    digitised = frontend.digitise(world.signals(TIMES[:400], random).sensed, random)
    measured = Inversion(design).measure(digitised.codes)["capacitance"]
    test = SelfTest([[int(k) for k in row if k >= 0] for row in skin.neighbours])
    for number, (low, high) in enumerate(zip(measured.inf, measured.sup, strict=True)):
        test.take(number, low.tolist(), high.tolist(), len(low))
    dead, stuck = zip(*test.examine(), strict=True)
    assert [number for number, answer in enumerate(stuck) if answer == CERTAIN] == [5]
    assert [number for number, answer in enumerate(dead) if answer == CERTAIN] == [11]
