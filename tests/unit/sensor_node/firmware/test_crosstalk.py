"""Pads take back what their neighbours hand on, whatever becomes of these."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.firmware.taxel.pad import PadTaxel
from eskin_sensor_node.kinds.neighbours import patches
from eskin_sensor_node.machine.data_sheet import coverage, data_sheet, taxel_coverages
from eskin_sensor_node.world.scenario.file import scenario_text
from eskin_sensor_node.world.skin import Crosstalk, FlatShape, unmix
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st

from eskin.interval import Interval
from tests.unit.sensor_node.designs import SECOND, Bench, settings, table, taxel
from tests.unit.sensor_node.messages import samples_of

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.interval import Floats

GRID = FlatShape(shape="flat", rows=3, columns=4, pitch_m=1e-2).build()
PLACES = np.arange(len(GRID))
MOST = 2e4
TIMES = 5
SAMPLING = {"stretch_ms": 1000.0}


def felt(seed: int, bound: float) -> tuple[Floats, Interval]:
    """True pressures, and what each pad is known to feel."""
    random = np.random.default_rng(seed)
    pressure = random.choice([0.0, 100.0, MOST], (len(GRID), TIMES)) * random.uniform(
        size=(len(GRID), TIMES)
    )
    total = Crosstalk.draw(GRID, bound, seed).among(PLACES).felt(pressure)
    wide = random.uniform(1.0, 500.0, (2, *total.shape))
    return pressure, Interval(total - wide[0], total + wide[1])


def separated(
    known: Interval, bound: float, doubtful: int, missing: tuple[int, ...] = ()
) -> Interval:
    """The pressures that the firmware states."""
    sheet = data_sheet(taxel("pad", pressure_max_Pa=MOST))
    sheet |= {"crosstalk": bound, "doubtful_neighbours": float(doubtful)}
    made, bounds = [], []
    for number in range(len(GRID)):
        own = [[0.0] * TIMES for _ in range(10)]
        own[8], own[9] = known.inf[number].tolist(), known.sup[number].tolist()
        bounds.append(own)
        made.append(PadTaxel(sheet))
    for number, pad in enumerate(made):
        beside = [int(k) for k in GRID.neighbours[number] if k >= 0]
        pad.surround(len(beside))
        around = [made[k].felt(bounds[k]) for k in beside if k not in missing]
        pad.separate(TIMES, bounds[number], around)
    return Interval(*(np.array([own[k] for own in bounds]) for k in (8, 9)))


@effort(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32),
    st.sampled_from([0.0, 0.1, 0.5]),
    st.integers(0, 2),
    st.sampled_from([-5e3, 0.0, 10.0, 3e4]),
    st.sampled_from([(), (1,), (1, 6), tuple(range(12))]),
)
def test_truth_is_inside_with_neighbours_stuck_saturated_or_missing(
    seed: int,
    bound: float,
    doubtful: int,
    lie: float,
    missing: tuple[int, ...],
) -> None:
    pressure, known = felt(seed, bound)
    lo, hi = known.inf.copy(), known.sup.copy()
    random = np.random.default_rng(seed)
    low, high, dead, *stuck = random.permutation(len(GRID))[: 3 + doubtful]
    lo[stuck], hi[stuck] = lie - 1.0, lie + 1.0
    lo[low], hi[high] = -np.inf, np.inf
    lo[dead], hi[dead] = -np.inf, lie  # an open line
    reported = separated(Interval(lo, hi), bound, doubtful, missing)
    sound = np.setdiff1d(PLACES, [dead, *stuck])
    assert np.all(reported[sound].contains(pressure[sound]))


def test_it_is_as_tight_as_all_pads_together() -> None:
    _, known = felt(3, 0.2)
    best = unmix(known, GRID.neighbours, bound=0.2, most=MOST)
    reported = separated(known, 0.2, 0)
    assert np.allclose(reported.inf, best.inf, rtol=0.0, atol=1e-6)
    assert np.allclose(np.minimum(reported.sup, MOST), best.sup, rtol=0.0, atol=1e-6)
    widths = [float(separated(known, 0.2, doubtful).wid.mean()) for doubtful in (0, 1, 2, 4)]
    assert widths == sorted(widths)
    alone = separated(known, 0.2, 0, tuple(range(12)))
    assert widths[-1] == pytest.approx(float(alone.wid.mean()))


def skin(scenario: str, places: list[str], **changes: Any) -> list[dict[str, Any]]:
    """Pads and what they read along."""
    pads = [
        table("pad", id=place, place=place, scenario=scenario, sampling_Hz=50.0, **changes)
        for place in places
    ]
    return [*pads, *(table(kind, scenario=scenario) for kind in ("thermometer", "hygrometer"))]


def test_sound_pads_around_a_stuck_one_hold_the_truth(tmp_path: Path) -> None:
    path = tmp_path / "stuck.toml"
    fault = '\n[[fault]]\ntaxel = "t10"\nkind = "stuck"\nat_s = 0.2\n'
    path.write_text(scenario_text("hand.toml") + fault)
    names = [f"t{number:02}" for number in range(12)]
    bench = Bench(tmp_path, "hand", taxel=skin(str(path), names), sampling=SAMPLING)
    bench.node.taxels[2].sample_every(SECOND // 10)  # t02 has other instants now
    bench.run_to(8.0)
    found = samples_of(bench)
    for each in found:
        if not each.channel.startswith("t10."):
            assert each.hold_truth(), each.channel
    assert {each.channel for each in found} >= {f"{name}.contact_area" for name in names}
    stuck = [each for each in found if each.channel == "t10.pressure"]
    values = [each.tube.values for each in stuck]
    touched = np.concatenate([each.truth > 5e3 for each in stuck])
    stated = np.concatenate([each.inf > -np.inf for each in values])
    right = np.concatenate([v.contains(each.truth) for v, each in zip(values, stuck, strict=True)])
    assert np.any(touched)
    assert not np.any(touched & stated & right), "it knows nothing of a touch"
    bench.close()


def test_pad_among_pads_is_tighter_than_alone(tmp_path: Path) -> None:
    widths = []
    for names in (["t10"], ["t10", "t06", "t09", "t11"]):
        bench = Bench(
            tmp_path / names[-1], "hand", taxel=skin("hand.toml", names), sampling=SAMPLING
        )
        bench.run_to(6.5)
        presses = [
            each.tube.values.wid[each.truth > 5e3] for each in samples_of(bench, "t10.pressure")
        ]
        widths.append(float(np.concatenate(presses).mean()))
        bench.close()
    assert widths[1] < widths[0] - 700.0  # Pa


def test_more_stuck_neighbours_than_a_data_sheet_allows_for_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "stuck.toml"
    fault = '\n[[fault]]\ntaxel = "{}"\nkind = "stuck"\n'
    path.write_text(scenario_text("hand.toml") + fault.format("t06") + fault.format("t01"))
    with pytest.raises(ValueError, match="t01 and t06 beside t05 get stuck"):
        settings(tmp_path, "hand", taxel=skin(str(path), ["t05"]))
    settings(tmp_path, "hand", taxel=skin(str(path), ["t05"], doubtful_neighbours=2))
    settings(tmp_path, "hand", taxel=skin(str(path), ["t07"]))


def test_neighbours_are_those_of_the_skin_and_their_noise_counts(tmp_path: Path) -> None:
    noise = {"kind": "gaussian", "sigma": 1e-7, "k": 4.0}
    made = settings(tmp_path, "hand", taxel=skin("hand.toml", ["t05", "t06", "t11"], noise=noise))
    found = patches(made.taxel)
    assert found == {0: (4, [1]), 1: (4, [0]), 2: (2, [])}
    alone = coverage(made.taxel[0], {})
    assert taxel_coverages(made)[0] == pytest.approx(1.0 - 2.0 * (1.0 - alone), abs=1e-15)
    assert taxel_coverages(made)[2] == pytest.approx(alone, abs=1e-15)


def test_neighbour_counts_at_the_same_instants_and_as_long_as_it_is_sound(tmp_path: Path) -> None:
    names = ["t10", "t06", "t09", "t11"]
    bench = Bench(tmp_path, "hand", taxel=skin("hand.toml", names), sampling=SAMPLING)
    pads = bench.node.taxels[:4]
    counts = []
    for change in (
        lambda: pads[0],
        lambda: pads[1].sample_every(SECOND // 10),
        lambda: setattr(pads[2].control_unit, "broken", True),
    ):
        change()
        bench.run_to(bench.ticks / SECOND + 1.0)
        counts.append(pads[0].control_unit.known_neighbours)
    assert counts == [3, 2, 1]
    bench.close()
