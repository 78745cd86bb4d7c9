"""Budgets of energy, from the firmware really running."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.machine.power.harvest import Harvester, Layers, Touches, harvest_bounds
from eskin_sensor_node.machine.power.loads import Loads, bounds
from eskin_sensor_node.machine.power.supply import Supply
from eskin_sensor_node.machine.work_counters import WorkCounters
from eskin_sensor_node.profile import profile_names
from eskin_sensor_node.settings import EnergySection
from eskin_sensor_node.tools.budget import Budget, NodeDesign, saving
from eskin_sensor_node.tools.budget.design import MODES
from hypothesis import example, given
from hypothesis import strategies as st
from typer.testing import CliRunner

from eskin.cli import app
from eskin.cli.energy import _watts
from eskin.errors import SettingsError
from eskin.interval import Interval, Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

SECONDS = 6
CONVERSIONS = 250 * 14 * 3 + 250 * 2 * 3 + 250 + 2 * 50
"""A second: 14 pads, of which one reads the air along; 2 coils; an electrode; the air."""
_UNITS = {
    "W": Fraction(1),
    "mW": Fraction(1, 10**3),
    "µW": Fraction(1, 10**6),
    "nW": Fraction(1, 10**9),
}


def nothing(_: int) -> None:
    pass


@pytest.fixture(scope="module")
def hand() -> Sequence[Budget]:
    design = NodeDesign.named("hand")
    return [Budget.measure(design, mode, SECONDS, nothing) for mode in MODES]


def test_frugal_modes_send_less_and_sense_as_much(hand: Sequence[Budget]) -> None:
    samples, adaptive, peaks = hand
    assert samples.work.sent > adaptive.work.sent > peaks.work.sent > 0
    # Frames that are not complete at the end are not counted.
    most = CONVERSIONS * SECONDS
    assert samples.work.conversions == peaks.work.conversions
    assert 0.99 * most < samples.work.conversions <= most
    assert samples.work.span == SECONDS * 10**9


def test_peaks_only_certainly_saves_most_of_the_hand(hand: Sequence[Budget]) -> None:
    watts, share = saving(hand[0], hand[2])
    assert float(share.inf) > 0.5
    assert float(watts.inf) > 0.0


def test_saving_encloses_what_true_prices_save(hand: Sequence[Budget]) -> None:
    full, frugal = hand[0], hand[2]
    watts, share = saving(full, frugal)
    section = full.design.settings.energy
    for seed in range(50):
        loads = Loads(section, ColumnGenerator(seed, 0))
        one, other = (sum(loads.costs(each.work)) / SECONDS for each in (full, frugal))
        assert watts.contains(one - other)
        assert float(share.inf) <= (one - other) / (one + 6e-6)
        assert (one - other) / one <= float(share.sup)


def test_bounds_enclose_true_prices_and_true_layers() -> None:
    section = EnergySection(coil_inductance=0.01)
    work, touches = (
        WorkCounters(10**7, 5000, 9000, 700, 8000, 9, 10**6, 10**9, 2 * 10**9),
        Touches(3.0, 2e-3),
    )
    harvest = harvest_bounds(section, touches)
    total = harvest["piezoelectric"] + harvest["triboelectric"]
    for seed in range(50):
        for name, true in Loads(section, ColumnGenerator(seed, 0)).costs(work)._asdict().items():
            assert bounds(section, work)[name].contains(true), name
        assert total.contains(Layers(section, ColumnGenerator(seed, 0)).energy(touches))


def test_touches_of_the_hand_are_harvested_however_time_is_cut() -> None:
    taxels = NodeDesign.named("hand").settings.taxel
    whole = Harvester(taxels).touches(20.0)
    cut = Harvester(taxels)
    parts = [cut.touches(second / 4) for second in range(1, 81)]
    assert whole.swings == pytest.approx(sum(part.swings for part in parts))
    assert whole.released == pytest.approx(sum(part.released for part in parts))
    assert whole.swings > 1.0
    # Five taps and some more touches, each of some square centimetres.
    assert 1e-4 < whole.released < 1e-1


def test_verdict_is_certain_where_touches_give_more_than_sleep_costs(
    hand: Sequence[Budget],
) -> None:
    idle = replace(hand[2], work=WorkCounters(span=SECONDS * 10**9))
    assert hand[0].verdict is Verdict.IMPOSSIBLE
    assert replace(idle, touches=Touches(0.0, 1.0)).verdict is Verdict.CERTAIN
    assert replace(idle, touches=hand[2].touches).verdict is Verdict.POSSIBLE


@pytest.fixture(scope="module")
def shoes() -> dict[str, Budget]:
    return {name: Budget.measure(NodeDesign.named(name), "peaks", 20, nothing) for name in SHOES}


def net_powers(budget: Budget, draws: int) -> list[float]:
    """Harvest less consumption in W of some nodes with other true parts, at any voltage."""
    section, found = budget.design.settings.energy, []
    for seed in range(draws):
        random = np.random.default_rng(seed)
        parts = ColumnGenerator(seed, 0)
        supply, layers = Supply(section, parts), Layers(section, parts)
        supply.energy *= random.uniform(0.6, 1.0)
        gained, before = layers.energy(budget.touches), supply.energy
        # In steps as the plant has them, that the supply burns and leaks what it truly does.
        for _ in range(4 * budget.seconds):
            supply.pass_span(WorkCounters(span=250_000_000), 0.0)
        leaked = before - supply.energy
        spent = sum(Loads(section, ColumnGenerator(seed, 0)).costs(budget.work))
        found.append((gained - spent - leaked) / budget.seconds)
    return found


SHOES = {"sole": Verdict.POSSIBLE, "sock": Verdict.POSSIBLE}


@pytest.mark.parametrize("name", SHOES)
def test_verdicts_of_packaged_profiles_hold_for_every_true_part(
    shoes: dict[str, Budget], hand: Sequence[Budget], name: str
) -> None:
    assert {name: each.verdict for name, each in shoes.items()} == SHOES
    assert hand[2].verdict is Verdict.IMPOSSIBLE
    signs = {power >= 0.0 for power in net_powers(shoes[name], 60)}
    # Few parts would have to be at their best end, all at once, that the sock's harvest suffices.
    assert signs == ({True, False} if name == "sole" else {False})
    assert max(net_powers(hand[2], 20)) < 0.0
    # Steps are stated: what is saved is not what the node is for.
    assert shoes[name].work.sent > 2000


def test_paper_hand_takes_a_thousand_times_what_the_paper_counts() -> None:
    design = NodeDesign.named("paper-hand")
    assert design.modes == ("samples",)
    budget = Budget.measure(design, "samples", 2, nothing)
    # Each taxel 50 times a second, and the air once for all of them.
    assert budget.work.conversions == (8400 + 2) * 50 * 2
    a_reading = budget.filled / (budget.work.conversions / budget.seconds)
    assert a_reading.contains(0.125e-6)
    # What the paper leaves out: filling burns as much again, and the machine takes the most.
    assert (budget.filled * 2.0).subset(budget.spent["sensing"] + Interval(-1e-6, 1e-6))
    assert float(budget.consumption.inf) > 0.5
    # Two bounds of 24 bits a sample would be six bytes.
    assert budget.work.sent < 2 * 8400 * 50 * budget.seconds


def test_command_prints_a_table_and_json() -> None:
    shown = CliRunner().invoke(app, ["energy", "--profile", "fingertip", "--seconds", "1"])
    assert shown.exit_code == 0
    assert "self-sustaining" in shown.output
    given = ["energy", "--profile", "fingertip", "--seconds", "1", "--json"]
    found = json.loads(CliRunner().invoke(app, given).output)
    assert list(found["modes"]) == list(MODES)
    low, high = found["modes"]["peaks"]["saving"]["share"]
    assert 0.0 < low < high < 1.0


@given(st.floats(1e-10, 1e4), st.floats(0.0, 1e-12))
@example(816.0360000000001, 0.0)
@example(0.010000000000000002, 0.0)
def test_power_is_printed_outward(low: float, more: float) -> None:
    said, unit = _watts(Interval(low, low + more)).split("] ")
    shown = [Fraction(bound) * _UNITS[unit] for bound in said.strip("[").split(", ")]
    assert shown[0] <= Fraction(low) <= Fraction(low + more) <= shown[1]


def test_table_encloses_the_json() -> None:
    given = ["energy", "--profile", "fingertip", "--seconds", "1"]
    table = CliRunner().invoke(app, given).output
    saving = json.loads(CliRunner().invoke(app, [*given, "--json"]).output)["modes"]["peaks"]
    (found,) = re.findall(r"peaks saves .*, \[(.*), (.*)\] %", table)
    low, high = (100 * Fraction(bound) for bound in saving["saving"]["share"])
    other = Fraction(1, 5)  # keys are drawn anew in each run, and so the bytes of messages
    assert Fraction(found[0]) - other <= low < high <= Fraction(found[1]) + other


def test_command_names_what_is_allowed() -> None:
    assert "paper-hand" in profile_names()
    with pytest.raises(SettingsError, match="palm, paper-hand"):
        NodeDesign.named("foot")
