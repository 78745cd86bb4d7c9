"""The air: measured by a node's own sensors, and what a pad knows of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mpmath
import numpy as np
import pytest
from eskin_sensor_node.columns.sensing import SensingColumns
from eskin_sensor_node.firmware.inversion.thermometer import celsius_bounds
from eskin_sensor_node.kinds.settings import Companion
from eskin_sensor_node.machine.data_sheet import coverage
from eskin_sensor_node.machine.inversion import Inversion
from eskin_sensor_node.settings import NodeSettings
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eskin.errors import SettingsError
from tests.unit.sensor_node.designs import Bench, table, taxel
from tests.unit.sensor_node.designs import settings as node_settings
from tests.unit.sensor_node.messages import assert_truth_is_inside, samples_of
from tests.unit.sensor_node.scenario.scripts import HEAD, write

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.kinds.converter import Codes
    from eskin_sensor_node.kinds.settings import TaxelSection

    from eskin.interval import Floats, Interval

ROLES = ("thermometer", "hygrometer")
QUIET = {"kind": "uniform", "bound": 0.0}

IEC_60751 = [
    # °C and ohm of a Pt100, as the norm's table prints them
    *[(-200.0, 18.52), (-100.0, 60.26), (-50.0, 80.31), (-10.0, 96.09), (0.0, 100.0)],
    *[(10.0, 103.90), (50.0, 119.40), (100.0, 138.51), (400.0, 247.09), (850.0, 390.48)],
]


@pytest.mark.parametrize(("celsius", "ohm"), IEC_60751)
def test_platinum_follows_the_table_of_the_norm(celsius: float, ohm: float) -> None:
    lo = celsius_bounds((ohm - 0.005) / 100.0 - 1.0)[0]
    hi = celsius_bounds((ohm + 0.005) / 100.0 - 1.0)[1]
    assert lo - 1e-9 <= celsius <= hi + 1e-9
    if abs(celsius) < 200.0:
        assert hi - lo < 0.03


@given(st.one_of(st.floats(-196.0, 845.0), st.floats(-1e-3, 1e-3)))
def test_celsius_is_enclosed_tightly(celsius: float) -> None:
    with mpmath.workprec(200):
        t, a, b, c = (mpmath.mpf(x) for x in (celsius, "3.9083e-3", "-5.775e-7", "-4.183e-12"))
        exact = a * t + b * t**2 + (c * (t - 100) * t**3 if celsius < 0 else 0)
        # The float nearest to the ratio stands for another temperature: so little further.
        slack = abs(t) * mpmath.mpf(2) ** -51 + mpmath.mpf(2) ** -1000
        lo, hi = celsius_bounds(float(exact))
        assert lo - slack <= t <= hi + slack
        assert hi - lo <= 1e-12 * abs(celsius) + (1e-3 if celsius < -50.0 else 1e-9)


def companions(**noise: Any) -> dict[str, Companion]:
    return {role: Companion(taxel(role, **noise), number) for number, role in enumerate(ROLES)}


def sensed(
    design: TaxelSection, read_along: dict[str, Companion], seed: int, n: int
) -> tuple[dict[str, Floats], dict[str, Codes]]:
    """What is true at n instants, and the codes of a taxel and what it reads along."""
    columns = SensingColumns(design, seeds=seed, numbers=len(ROLES), companions=read_along)
    seconds = np.sort(np.random.default_rng(seed).uniform(0.0, 60.0, n))
    found = columns.sense(1, np.rint(seconds * 1e9).astype(np.int64), seconds[None])
    codes = {name: values[0] for name, values in found.readings[0].codes.items()}
    return {name: values[0] for name, values in found.truth.items()}, codes


def measure(
    design: TaxelSection, read_along: dict[str, Companion], seed: int, n: int = 1000
) -> tuple[dict[str, Floats], dict[str, Interval]]:
    truth, codes = sensed(design, read_along, seed, n)
    return truth, Inversion(design, read_along).measure(codes)


@settings(
    max_examples=60, deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow]
)
@given(st.integers(0, 2**32), st.sampled_from([(), ROLES[:1], ROLES[1:], ROLES]), st.data())
def test_pad_holds_the_truth_with_any_sensors_of_the_air(
    seed: int, roles: tuple[str, ...], data: st.DataObject
) -> None:
    changes: dict[str, Any] = {
        "permittivity_per_K": data.draw(st.sampled_from([-0.01, -1e-3, 0.0, 0.01])),
        "permittivity_per_percent": data.draw(st.sampled_from([-1e-3, 0.0, 1e-3])),
        "place": data.draw(st.sampled_from(["t00", "t05", "t06", "t10", "t15"])),
    }
    found = companions()
    truth, stated = measure(taxel("pad", **changes), {role: found[role] for role in roles}, seed)
    for quantity in ("plate_distance", "contact_area", "pressure"):
        assert np.all(stated[quantity].contains(truth[quantity])), quantity


def test_own_sensors_of_the_air_make_pressure_much_tighter() -> None:
    design = taxel("pad", place="t05")
    widths = [
        float(np.mean(measure(design, read_along, 3)[1]["pressure"].wid))
        for read_along in ({}, companions())
    ]
    assert widths[1] < 0.25 * widths[0]


def test_each_sensor_s_error_is_taken_in_by_the_pad() -> None:
    exact = {
        f"{part}_tolerance": 0.0
        for part in (
            *("plate_area", "plate_distance", "relative_permittivity", "elasticity"),
            *("resistance", "reference", "transconductance"),
        )
    }
    design = taxel("pad", **exact, adc_bits=20, noise=QUIET, place="t20")
    for seed in range(20):
        read_along = companions()
        truth, stated = measure(design, read_along, seed, 200)
        assert np.all(stated["plate_distance"].contains(truth["plate_distance"]))
        # Nothing but their errors is uncertain: other true sensors would not do.
        others = {
            role: Companion(
                each.taxel.model_copy(update={"tolerance_K": 0.0, "error_percent": 0.0}),
                each.number,
            )
            for role, each in read_along.items()
        }
        narrow = Inversion(design, others).measure(codes_of(design, read_along, seed))
        missed = ~narrow["plate_distance"].contains(truth["plate_distance"])
        if np.any(missed):
            break
    else:
        pytest.fail("the sensors' errors are not in the pad's codes")


@pytest.mark.parametrize("slope", ["permittivity_per_K", "permittivity_per_percent"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("roles", [(), ROLES])
def test_tolerance_of_a_slope_is_taken_in(
    tmp_path: Path, slope: str, sign: float, roles: tuple[str, ...]
) -> None:
    exact = {
        f"{part}_tolerance": 0.0
        for part in (
            *("plate_area", "plate_distance", "relative_permittivity", "elasticity"),
            *("resistance", "reference", "transconductance"),
            *("permittivity_per_K", "permittivity_per_percent"),
        )
    }
    changes: dict[str, Any] = exact | {slope: 3e-3 * sign, f"{slope}_tolerance": 0.4}
    limits = {"temperature_min_Cel": 39.9, "temperature_max_Cel": 40.1}
    limits |= {"humidity_min_percent": 79.9, "humidity_max_percent": 80.1}
    air = "[ambient]\ntemperature_Cel = [[0.0, 40.0]]\nhumidity_percent = [[0.0, 80.0]]\n"
    scene = write(tmp_path, HEAD + air)
    usual: Any = taxel("pad")
    changes["resistance_ohm"] = usual.resistance_ohm * usual.plate_area_m2 / 9e-5
    changes |= {"plate_area_m2": 9e-5, "scenario": scene, "place": "t05", "noise": QUIET}
    design: Any = taxel("pad", **changes, **limits)
    precise = {"tolerance_K": 0.0, "tolerance_per_K": 0.0, "error_percent": 0.0}
    found = {
        role: Companion(taxel(role, scenario=scene, noise=QUIET).model_copy(update=precise), number)
        for number, role in enumerate(roles)
    }
    missed = 0
    for seed in range(10):
        truth, stated = measure(design, found, seed, 50)
        assert np.all(stated["plate_distance"].contains(truth["plate_distance"]))
        # Nothing else is as uncertain: a slope that is taken as exact would not do.
        exactly = design.model_copy(update={f"{slope}_tolerance": 0.0})
        stated = Inversion(exactly, found).measure(sensed(design, found, seed, 5)[1])
        missed += not np.all(stated["plate_distance"].contains(float(design.plate_distance_m)))
    assert missed > 5


def codes_of(design: TaxelSection, read_along: dict[str, Companion], seed: int) -> Any:
    return sensed(design, read_along, seed, 200)[1]


def test_sensor_that_is_read_along_is_the_one_that_the_node_has() -> None:
    noise = {"kind": "gaussian", "sigma": 1e-3}
    design, sensor = taxel("pad", place="t05"), taxel("thermometer", noise=noise)
    instants = np.arange(200) * 300_000_000
    codes = {
        (seed, number): SensingColumns(each, seeds=seed, numbers=number, companions=along)
        .sense(1, instants, instants[None] / 1e9)
        .readings[0]
        .codes
        for each, along, seed, number in (
            (design, {"thermometer": Companion(sensor, 0)}, 4, 2),
            (sensor, {}, 4, 0),
            (sensor, {}, 5, 0),
        )
    }
    for seed, same in ((4, True), (5, False)):
        read = codes[4, 2]["thermometer"]
        assert np.array_equal(read, codes[seed, 0]["share"]) == same


def test_broken_thermometer_leaves_the_pad_open_and_never_wrong() -> None:
    design = taxel("pad", place="t05")
    read_along = companions()
    codes = dict(codes_of(design, read_along, 1))
    codes["thermometer"] = np.zeros_like(codes["thermometer"])
    stated = Inversion(design, read_along).measure(codes)
    assert np.all(np.isfinite(stated["capacitance"].wid))
    assert np.all(np.isneginf(stated["plate_distance"].inf))
    assert np.all(np.isposinf(stated["pressure"].sup))


def test_coverage_of_what_is_read_along_counts() -> None:
    noise = {"kind": "gaussian", "sigma": 1e-7, "k": 3.0}
    pad, read_along = taxel("pad", noise=noise), companions(noise=noise)
    beyond = 1.0 - pad.noise.coverage
    assert 3.0 * beyond <= 1.0 - coverage(pad, read_along) <= 3.0 * beyond + 1e-15
    assert coverage(pad, {}) == pytest.approx(pad.noise.coverage, abs=1e-15)
    assert coverage(taxel("pad"), companions()) == 1.0
    assert 2.0 * beyond <= 1.0 - taxel("coil", noise=noise).coverage <= 2.0 * beyond + 1e-15


def test_node_reads_the_same_thermometer_for_itself_and_for_its_pads(tmp_path: Path) -> None:
    fine = {"adc_bits": 24, "noise": QUIET, "sampling_Hz": 50.0}
    sensors = [table(role, **fine, tolerance_K=1.0) for role in ROLES[:1]]
    pad = table("pad", **fine, place="t16", permittivity_per_K=0.01, hygrometer=None)
    bench = Bench(tmp_path, "hand", taxel=[pad, *sensors], sampling={"stretch_ms": 1000.0})
    bench.run_to(10.0)
    found = samples_of(bench)
    bench.close()
    assert_truth_is_inside(found)
    assert {each.channel for each in found} >= {"t00.pressure", "a01.temperature"}
    assert bench.settings.companions(bench.settings.taxel[0]) == {
        "thermometer": Companion(bench.settings.taxel[1], 1)
    }


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"thermometer": "a09"}, "t00.thermometer = 'a09': there is no such thermometer"),
    ({"thermometer": "a02"}, "t00.thermometer = 'a02': there is no such thermometer"),
    ({"crosstalk": 0.05}, "crosstalk = 0.05 is less than the scenario's skin has, 0.1"),
    (
        {"temperature_max_Cel": 25.0},
        "the scenario's temperature_Cel goes from 22 to 30, the data sheet from 0 to 25",
    ),
    (
        {"humidity_min_percent": 50.0},
        "the scenario's humidity_percent goes from 45 to 65, the data sheet from 50 to 100",
    ),
]


@pytest.mark.parametrize(("changes", "said"), REFUSED)
def test_pad_that_does_not_fit_its_node_or_its_air_is_refused(
    changes: dict[str, Any], said: str, tmp_path: Path
) -> None:
    tables = [table("pad", **changes), *(table(role) for role in ROLES)]
    with pytest.raises((SettingsError, ValueError)) as caught:
        node_settings(tmp_path, "hand", taxel=tables)
    assert said in str(caught.value)


def test_sensor_of_another_scenario_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text('description = "x"\nduration_s = 1.0\n[skin]\nshape = "hand"\npitch_mm = 20\n')
    tables = [table("pad", hygrometer=None), table("thermometer", scenario=str(other))]
    with pytest.raises(ValueError, match="t00 and its thermometer 'a01' play different scenarios"):
        node_settings(tmp_path, "hand", taxel=tables)
    assert isinstance(node_settings(tmp_path, "hand"), NodeSettings)
