"""Every interval that the firmware says encloses the truth."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.columns.sensing import SensingColumns
from eskin_sensor_node.kinds.registry import KINDS as REGISTRY
from eskin_sensor_node.machine.inversion import Inversion
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from tests.unit.sensor_node.designs import KINDS, taxel

if TYPE_CHECKING:
    from eskin_sensor_node.kinds.settings import TaxelSection

    from eskin.interval import Floats, Interval

SAMPLES = 2000
RUNS = 60  # of 2000 samples: more than 1e5 a kind

NOISES = {
    "capacitive": st.sampled_from([0.0, 1e-8, 1e-6, 2e-5]),
    "touch": st.sampled_from([0.0, 1e-8, 1e-6, 5e-6]),
    "inductive": st.sampled_from([0.0, 1e-6, 1e-4, 1e-3]),
    "hybrid": st.sampled_from([0.0, 1e-5, 1e-3, 0.05]),
    "pad": st.sampled_from([0.0, 1e-8, 1e-6, 2e-5]),
    "coil": st.sampled_from([0.0, 1e-6, 1e-4, 1e-3]),
    "thermometer": st.sampled_from([0.0, 1e-7, 1e-5, 1e-3]),
    "hygrometer": st.sampled_from([0.0, 1e-8, 1e-6, 2e-5]),
    "bioelectric": st.sampled_from([0.0, 1e-6, 1e-4, 1e-2]),
}
OF_ADJUSTMENT = {"gain_tolerance", "trimmer_tolerance", "actuator_step_tolerance"}
TOLERANCES = {
    kind: [
        name.removesuffix("_tolerance")
        for name in REGISTRY[kind].settings.model_fields
        if name.endswith("_tolerance") and name not in OF_ADJUSTMENT
    ]
    for kind in KINDS
}
ERRORS = {
    "pad": ("permittivity_per_K", "permittivity_per_percent"),
    "thermometer": ("tolerance_K", "tolerance_per_K"),
    "hygrometer": ("error_percent",),
    "bioelectric": ("input_offset_V",),
}
"""What else widens the intervals."""
SPANS = {"hybrid": 0.04, "pad": 100.0, "coil": 100.0, "thermometer": 20.0, "hygrometer": 20.0}
"""In s: all that happens, and some of it anew."""


def without_errors(kind: str) -> dict[str, float]:
    """Nothing is uncertain but the converter and the noise."""
    changes = {f"{name}_tolerance": 0.0 for name in TOLERANCES[kind]}
    return changes | dict.fromkeys(ERRORS.get(kind, ()), 0.0)


@st.composite
def designs(draw: st.DrawFn, kind: str) -> TaxelSection:
    """A taxel with any tolerances, ADC resolution and bounded noise."""
    changes: dict[str, Any] = {
        f"{name}_tolerance": draw(st.floats(0.0, 0.05)) for name in TOLERANCES[kind]
    }
    changes["adc_bits"] = draw(st.integers(4, 16))
    changes["adc_gain_error"] = draw(st.floats(0.0, 0.02))
    changes["adc_offset_error"] = draw(st.floats(0.0, 4.0))
    changes["adc_nonlinearity"] = draw(st.floats(0.0, 4.0))
    changes["noise"] = {"kind": "uniform", "bound": draw(NOISES[kind])}
    if kind in ("pad", "coil"):
        changes["place"] = draw(st.sampled_from(["t00", "t05", "t06", "t10", "t15"]))
    return taxel(kind, **changes)


def measure(
    design: TaxelSection, seed: int, n: int, span: float | None = None
) -> tuple[dict[str, Floats], dict[str, Interval]]:
    """The truth and what the firmware says, at random instants."""
    columns = SensingColumns(design, seeds=seed, numbers=0, companions={})
    span = SPANS.get(str(design.kind), 3.0) if span is None else span
    seconds = np.sort(np.random.default_rng(seed).uniform(0.0, span, n))
    sensed = columns.sense(1, np.arange(n), seconds[None])
    codes = {name: values[0] for name, values in sensed.readings[0].codes.items()}
    return {k: values[0] for k, values in sensed.truth.items()}, Inversion(design).measure(codes)


@pytest.mark.parametrize("kind", KINDS)
def test_intervals_hold_the_truth_under_bounded_noise(kind: str) -> None:
    seen: Counter[str] = Counter()

    @settings(
        max_examples=RUNS,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow],
        database=None,
    )
    @given(designs(kind), st.integers(0, 2**32))
    def check(design: TaxelSection, seed: int) -> None:
        truth, measured = measure(design, seed, SAMPLES)
        for quantity in design.units:
            holds = measured[quantity].contains(truth[quantity])
            assert np.all(holds), (quantity, int((~holds).sum()))
            seen[quantity] += SAMPLES

    check()
    assert all(count >= 100_000 for count in seen.values()), seen


@pytest.mark.parametrize(
    ("kind", "part"), [(kind, part) for kind, parts in TOLERANCES.items() for part in parts]
)
def test_each_part_s_tolerance_is_taken_in(kind: str, part: str) -> None:
    # One part alone is uncertain, so that no other width can hide its own.
    changes: dict[str, Any] = without_errors(kind)
    changes[f"{part}_tolerance"] = 0.05
    design = taxel(kind, **changes, adc_bits=16, noise={"kind": "uniform", "bound": 0.0})
    for seed in range(5):
        truth, measured = measure(design, seed, 500)
        for quantity in design.units:
            assert np.all(measured[quantity].contains(truth[quantity])), quantity


@pytest.mark.parametrize(
    ("kind", "error"), [(kind, error) for kind, errors in ERRORS.items() for error in errors]
)
def test_each_other_error_is_taken_in(kind: str, error: str) -> None:
    most = {"tolerance_K": 2.0, "tolerance_per_K": 0.04, "error_percent": 10.0}
    changes: dict[str, Any] = without_errors(kind) | {error: most.get(error, 1e-3)}
    design = taxel(kind, **changes, adc_bits=16, noise={"kind": "uniform", "bound": 0.0})
    for seed in range(5):
        truth, measured = measure(design, seed, 500)
        for quantity in design.units:
            assert np.all(measured[quantity].contains(truth[quantity])), quantity


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("error", ["gain_error", "offset_error", "nonlinearity"])
def test_each_error_of_the_converter_is_taken_in(kind: str, error: str) -> None:
    changes: dict[str, Any] = without_errors(kind)
    changes[f"adc_{error}"] = 0.02 if error == "gain_error" else 5.0
    design = taxel(kind, **changes, adc_bits=12, noise={"kind": "uniform", "bound": 0.0})
    for seed in range(5):
        truth, measured = measure(design, seed, 500)
        for quantity in design.units:
            assert np.all(measured[quantity].contains(truth[quantity])), quantity


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("k", [1.0, 2.0, 3.0, 6.0])
def test_misses_under_gaussian_noise_stay_within_the_coverage(kind: str, k: float) -> None:
    # Much noise and thin tolerances, so that a miss is not hidden by other width.
    sigma = {
        "capacitive": 5e-6,
        "touch": 4e-7,
        "inductive": 2e-4,
        "hybrid": 5e-3,
        "pad": 5e-6,
        "coil": 2e-4,
        "thermometer": 1e-4,
        "hygrometer": 5e-6,
        "bioelectric": 5e-3,
    }[kind]
    changes = without_errors(kind)
    changes |= {f"{name}_tolerance": 1e-6 for name in TOLERANCES[kind]}
    design = taxel(kind, **changes, adc_bits=16, noise={"kind": "gaussian", "sigma": sigma, "k": k})
    n = 100_000
    most = binom.ppf(1 - 1e-6, n, 1.0 - design.coverage)
    truth, measured = measure(design, 11, n)
    for quantity in design.units:
        misses = int((~measured[quantity].contains(truth[quantity])).sum())
        assert misses <= most, quantity
        if k == 1.0 and quantity not in ("contact_area", "pressure"):
            # The check can fail: the noise is really there. (What presses a pad is wide.)
            assert misses > 0.1 * most, quantity


SATURATIONS = [
    # kind, too low a top end, quantity to the side that opens at the highest code
    ("capacitive", {"adc_max_A": 2e-4}, {"capacitance": "lo", "current": "hi"}),
    ("touch", {"adc_max_A": 2e-4}, {"area": "lo", "capacitance": "lo", "energy": "lo"}),
    (
        "inductive",
        {"adc_max_V": 0.82},
        {"frequency": "hi", "inductance": "lo", "distance": "lo"},
    ),
]


@pytest.mark.parametrize(("kind", "changes", "open_sides"), SATURATIONS)
def test_saturation_opens_the_side_that_is_not_measured(
    kind: str, changes: dict[str, Any], open_sides: dict[str, str]
) -> None:
    design = taxel(kind, **changes)
    last = 2**12 - 1
    name = "voltage" if kind == "inductive" else "current"
    measured = Inversion(design).measure({name: np.array([0, 1000, last])})
    for quantity, side in open_sides.items():
        values = measured[quantity]
        opened = {"lo": np.isinf(values.inf), "hi": np.isinf(values.sup)}
        other = "lo" if side == "hi" else "hi"
        assert opened[side].tolist() == [False, False, True], quantity
        assert opened[other].tolist() == [True, False, False], quantity
    truth, seen = measure(design, 5, 5000)
    assert any(np.isinf(seen[q].inf).any() or np.isinf(seen[q].sup).any() for q in open_sides)
    for quantity in open_sides:
        assert np.all(seen[quantity].contains(truth[quantity])), quantity


def test_hybrid_saturation_opens_both_ways() -> None:
    truth, measured = measure(taxel("hybrid", adc_max_V=0.3), 5, 5000, span=0.04)
    for quantity in ("current", "voltage"):
        assert np.isneginf(measured[quantity].inf).any()
        assert np.isposinf(measured[quantity].sup).any()
        assert np.all(measured[quantity].contains(truth[quantity]))


def test_distance_is_unknown_where_the_frequency_fits_no_distance() -> None:
    # Far below the empty coil's frequency no distance explains the code.
    design = taxel("inductive", adc_min_V=0.1, adc_max_V=0.9)
    measured = Inversion(design).measure({"voltage": np.array([500, 3700])})
    assert measured["distance"].inf[0] == -np.inf
    assert measured["distance"].sup[0] == np.inf
    assert np.isfinite(measured["distance"].sup[1])


WIDTHS = {
    "capacitive": {"capacitance": 0.01, "current": 0.006},
    "touch": {"area": 0.12, "capacitance": 0.12, "energy": 0.12},
    "inductive": {"frequency": 3e-4, "inductance": 3e-3, "distance": 0.1},
    "hybrid": {"current": 0.01, "voltage": 0.01},
    "pad": {"capacitance": 0.01, "current": 0.005},
    "coil": {"frequency": 5e-4, "inductance": 3e-3, "eddy_amplitude": 0.01},
    "thermometer": {"temperature": 0.03},
    "hygrometer": {"humidity": 0.2},
    "bioelectric": {"bioelectric": 0.15},
}


@pytest.mark.parametrize("kind", KINDS)
def test_packaged_designs_measure_sensibly(kind: str) -> None:
    truth, measured = measure(taxel(kind), 5, 20_000)
    for quantity, most in WIDTHS[kind].items():
        width = measured[quantity].wid
        size = np.abs(truth[quantity])
        # Signals that cross zero are judged by their typical size.
        crosses = kind in ("hybrid", "bioelectric")
        relative = width / (np.sqrt(np.mean(size**2)) if crosses else size)
        assert np.mean(relative) < most, (quantity, float(np.mean(relative)))
