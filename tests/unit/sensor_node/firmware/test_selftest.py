"""Stuck and dead taxels are found on the node, and healthy ones are never accused."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.firmware.selftest import (
    CERTAIN,
    IMPOSSIBLE,
    POSSIBLE,
    BoundsWindow,
    SelfTest,
)
from eskin_sensor_node.node.self_test import SELF_TEST_WINDOW
from eskin_sensor_node.profile import Profile
from eskin_sensor_node.world.scenario.file import scenario_text
from eskin_sensor_node.world.skin import FlatShape
from hypothesis import given
from hypothesis import strategies as st

from eskin.interval import Verdict
from eskin.wire.messages import Status, TaxelFaults
from tests.unit.sensor_node.designs import SECOND, Bench, table
from tests.unit.sensor_node.messages import Samples, decode, gaps_of, samples_of

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.interval import Floats
    from eskin.wire.frames import Gap

GRID = FlatShape(shape="flat", rows=3, columns=3, pitch_m=1e-2).build()
MIDDLE = 4
WIDTH = 0.1


def swinging(stuck: tuple[int, ...] = (), size: float = 1.0) -> tuple[Floats, Floats]:
    """Bounds that swing alike, but for the stuck ones; noise is a part of their width."""
    values = np.tile(size * np.sin(np.linspace(0.0, 6.0, 200)), (len(GRID), 1))
    values[list(stuck)] = 0.3
    values += np.random.default_rng(2).uniform(-WIDTH / 10, WIDTH / 10, values.shape)
    return values - WIDTH / 2, values + WIDTH / 2


def examined(lows: Floats, highs: Floats) -> tuple[list[int], list[int]]:
    """Whether each is dead, and whether it is stuck."""
    test = SelfTest([[int(k) for k in row if k >= 0] for row in GRID.neighbours])
    for number in range(len(lows)):
        for begin in range(0, 200, 60):
            lo, hi = lows[number, begin : begin + 60], highs[number, begin : begin + 60]
            test.take(number, lo.tolist(), hi.tolist(), len(lo))
    dead, stuck = zip(*test.examine(), strict=True)
    return list(dead), list(stuck)


def test_taxel_that_stays_while_all_around_it_move_is_certainly_stuck() -> None:
    dead, stuck = examined(*swinging((MIDDLE,)))
    assert dead == [IMPOSSIBLE] * 9
    assert stuck == [CERTAIN if number == MIDDLE else IMPOSSIBLE for number in range(9)]


def test_nothing_is_certain_where_the_neighbours_do_not_certainly_move() -> None:
    assert examined(*swinging(tuple(range(9))))[1] == [POSSIBLE] * 9
    assert CERTAIN not in examined(*swinging((MIDDLE,), size=0.05))[1]


def test_one_neighbour_that_stays_is_enough_for_doubt() -> None:
    assert examined(*swinging((MIDDLE, 1)))[1][MIDDLE] == POSSIBLE


@pytest.mark.parametrize("side", ["lo", "hi", "both"])
def test_taxel_without_a_bounded_sample_is_dead(side: str) -> None:
    lows, highs = swinging()
    if side != "hi":
        lows[2] = -np.inf
    if side != "lo":
        highs[2] = np.inf
    dead, stuck = examined(lows, highs)
    assert dead == [CERTAIN if number == 2 else IMPOSSIBLE for number in range(9)]
    assert stuck[2] == POSSIBLE


def test_taxel_that_saturates_at_times_is_possibly_dead_and_not_constant() -> None:
    lows, highs = swinging((MIDDLE,))
    highs[MIDDLE, 10:20] = np.inf
    dead, stuck = examined(lows, highs)
    assert (dead[MIDDLE], stuck[MIDDLE]) == (POSSIBLE, POSSIBLE)


def test_dead_neighbours_are_passed_over_but_one_must_live() -> None:
    lows, highs = swinging((MIDDLE,))
    highs[1] = np.inf
    assert examined(lows, highs)[1][MIDDLE] == CERTAIN
    highs[[3, 5, 7]] = np.inf
    assert examined(lows, highs)[1][MIDDLE] == POSSIBLE


def test_window_begins_anew() -> None:
    test = SelfTest([[]])
    test.take(0, [-np.inf], [1.0], 1)
    assert test.examine() == [(CERTAIN, POSSIBLE)]
    test.take(0, [0.0], [1.0], 1)
    assert test.examine() == [(IMPOSSIBLE, POSSIBLE)]


@given(st.lists(st.tuples(*3 * [st.floats(-1e6, 1e6)]).map(sorted), min_size=1))
def test_movement_encloses_the_range_of_every_signal_in_the_tube(
    samples: list[list[float]],
) -> None:
    window = BoundsWindow()
    lows, inside, highs = ([sample[k] for sample in samples] for k in range(3))
    window.take(lows, highs, len(samples))
    least, most = window.moved
    assert least <= max(inside) - min(inside) <= most


FAULTS = """
[[fault]]
taxel = "t06"
kind = "stuck"
at_s = 4.0

[[fault]]
taxel = "t15"
kind = "stuck"
at_s = 4.0

[[fault]]
taxel = "t03"
kind = "dead"
at_s = 7.0
"""


def lived(folder: Path, faults: str, seconds: float) -> tuple[list[Samples], list[Gap], int]:
    """What the packaged hand says, with faults in its scenario, and when it began."""
    path = folder / "faulty.toml"
    path.write_text(scenario_text("hand.toml") + faults)
    taxels = [
        each | {"scenario": str(path), "sampling_Hz": 25.0} for each in Profile.read("hand").taxels
    ]
    bench = Bench(folder, "hand", taxel=taxels, sampling={"stretch_ms": 1000.0})
    for _ in range(round(seconds)):
        bench.run_to(bench.ticks / SECOND + 1.0)
    samples, gaps = samples_of(bench), gaps_of(bench)
    bench.close()
    return samples, gaps, bench.clock.true_time(0)


def ends(samples: list[Samples], channel: str, begin: int) -> list[float]:
    """Seconds at which stretches of a channel end."""
    own = [each for each in samples if each.channel == channel]
    return [(each.tube.time[1] - begin) / SECOND + 1.0 for each in own]


def test_injected_faults_are_found_within_two_windows(
    tmp_path: Path,
) -> None:
    samples, gaps, begin = lived(tmp_path, FAULTS, 65.0)
    first = {gap.reason: (gap.time[1] - begin) / SECOND for gap in reversed(gaps)}
    # A coil at the place of t06 is stuck with it; two coils are too few to tell.
    assert set(first) == {"t06 certainly stuck", "t15 certainly stuck", "t03 certainly dead"}
    assert all(end <= 7.0 + 2 * SELF_TEST_WINDOW / SECOND for end in first.values())
    for reason, end in first.items():
        taxel = reason.partition(" ")[0]
        stated = [gap for gap in gaps if gap.reason == reason]
        assert stated[0].samples == 0
        for quantity in ("plate_distance", "contact_area", "pressure"):
            assert max(ends(samples, f"{taxel}.{quantity}", begin)) <= end + 0.1
        assert max(ends(samples, f"{taxel}.capacitance", begin)) > 64.0
        # All that was not stated is in a gap, but for what is younger than the last one.
        omitted_samples = 3 * 25 * round((stated[-1].time[1] - begin) / SECOND - end)
        assert sum(gap.samples for gap in stated) == omitted_samples > 0


@pytest.mark.nightly
def test_healthy_hand_is_not_accused_in_six_rounds(tmp_path: Path) -> None:
    _, gaps, _ = lived(tmp_path, "", 120.0)
    assert gaps == []


def broken(bench: Bench) -> list[str]:
    return [taxel.name for taxel in bench.node.taxels if taxel.control_unit.broken]


def test_taxel_that_cannot_be_broken_any_more_is_believed_again(tmp_path: Path) -> None:
    pad = table("pad", adc_max_A=7e-4, sampling_Hz=25.0, thermometer=None, hygrometer=None)
    bench = Bench(tmp_path, "hand", taxel=[pad], sampling={"stretch_ms": 1000.0})
    unit = bench.node.taxels[0].control_unit
    bench.run_to(45.0)
    assert bench.node._self_test.faults == [("t00", CERTAIN, POSSIBLE)]
    assert list(broken(bench)) == ["t00"]  # it saturated all the time: as an open line does
    unit._taxel._adc = (1e-7, 1e-7, 0.0, 0.0, 0.0)  # as if the contact had gone
    unit._taxel.last = 1 << 20
    bench.run_to(82.0)
    assert list(broken(bench)) == []
    assert bench.node._self_test.faults == [("t00", IMPOSSIBLE, POSSIBLE)]
    bench.node.record_status()
    (stated,) = [m for m in map(decode, bench.bodies()) if isinstance(m, Status)]
    assert stated.faults == (TaxelFaults("t00", Verdict.IMPOSSIBLE, Verdict.POSSIBLE),)
    gaps = gaps_of(bench)
    assert {gap.reason for gap in gaps} == {"t00 certainly dead"}
    assert [gap.samples for gap in gaps] == [0, 3 * 25 * 20, 3 * 25 * 20, 3 * 25 * 20]
    assert len(samples_of(bench, "t00.pressure")) == 20 + 2
    bench.close()
