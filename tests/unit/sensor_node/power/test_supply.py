"""The firmware's intervals of energy against the true supply."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.firmware.energy import (
    ADAPTIVE,
    CERTAIN,
    FULL,
    IMPOSSIBLE,
    PEAKS,
    POSSIBLE,
    SLEEP,
    EnergyManager,
    thrice,
)
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.machine.power.data_sheet import energy_sheet
from eskin_sensor_node.machine.power.supply import Flows, Supply
from eskin_sensor_node.machine.work_counters import WorkCounters
from eskin_sensor_node.settings import EnergySection
from hypothesis import given, settings
from hypothesis import strategies as st

if TYPE_CHECKING:
    from typing import Any

SECOND = 1_000_000_000
SPAN = SECOND // 4
IDLE = WorkCounters(asleep=SPAN, on=SPAN, span=SPAN)


def made(seed: int = 1, **keys: Any) -> tuple[Supply, EnergyManager]:
    section = EnergySection(on=True, **keys)
    return Supply(section, ColumnGenerator(seed, 0)), EnergyManager(energy_sheet(section))


def busy(cycles: int, conversions: int, sent: int, received: int = 0) -> WorkCounters:
    """A quarter of a second with some work, and awake for half of it."""
    return WorkCounters(
        cycles, conversions, sent, received, fewest=cycles, asleep=SPAN // 2, on=SPAN, span=SPAN
    )


def live(
    supply: Supply, manager: EnergyManager, work: WorkCounters, harvested: float, steps: int
) -> None:
    for _ in range(steps):
        supply.pass_span(work, harvested)
        manager.watch(supply.code(), work)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    start=st.floats(2.3, 3.8),
    capacitance=st.floats(1e-4, 10.0),
    tolerance=st.floats(0.0, 0.4),
    series=st.floats(1e-3, 50.0),
    bits=st.integers(8, 20),
    coil=st.sampled_from([0.0, 0.01]),
    busy=st.floats(0.0, 1.0),
    rate=st.floats(0.0, 2.0),
)
def test_every_interval_encloses_the_true_supply(
    seed: int,
    start: float,
    capacitance: float,
    *,
    tolerance: float,
    series: float,
    bits: int,
    coil: float,
    busy: float,
    rate: float,
) -> None:
    random = np.random.default_rng(seed)
    supply, manager = made(
        seed,
        start_voltage=start,
        capacitance=capacitance,
        capacitance_tolerance=tolerance,
        series_resistance=series,
        adc_bits=bits,
        coil_inductance=coil,
        horizon_s=2.0,
    )
    manager.watch(supply.code(), IDLE)
    begin, stored = copy.copy(supply.flows), supply.energy
    for _ in range(30):
        cycles, on = int(2e6 * busy * random.random()), int(SPAN * random.random())
        work = WorkCounters(
            cycles=cycles,
            conversions=int(1e3 * busy * random.random()),
            sent=int(2e3 * busy * random.random()),
            received=int(1e3 * busy * random.random()),
            written=int(1e3 * busy * random.random()),
            wakes=int(1e2 * busy * random.random()),
            fewest=int(cycles * random.random()),
            asleep=int(on * random.random()),
            on=on,
            span=SPAN,
        )
        before, over = copy.copy(supply.flows), manager._lasted == 0
        if over:
            begin, stored = before, supply.energy
        supply.pass_span(work, rate * 5e-4 * random.random())
        if supply.failing:
            return
        manager.watch(supply.code(), work)
        assert_encloses(supply, manager, begin, stored)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    start=st.floats(2.3, 3.8),
    seconds=st.floats(0.0, 1e7),
    tolerance=st.floats(0.0, 0.4),
    off=st.integers(0, 2 * SECOND),
)
def test_charge_that_flash_kept_encloses_what_the_time_away_leaves(
    seed: int, start: float, seconds: float, *, tolerance: float, off: int
) -> None:
    keys: dict[str, Any] = {"start_voltage": start, "capacitance_tolerance": tolerance}
    supply, manager = made(seed, **keys, leakage_resistance_tolerance=tolerance)
    manager.watch(supply.code(), IDLE)
    end, away = 1_790_000_000 * SECOND, int(seconds * SECOND)
    record = manager.rest((end - off, end + off))
    supply.rest(supply.energy, away / SECOND)
    _, later = made(seed, **keys, leakage_resistance_tolerance=tolerance)
    later.recall(record, (end + away - off, end + away + off))
    assert later.stored[0] <= supply.energy <= later.stored[1] * (1.0 + 1e-12)
    section = EnergySection(on=True, **keys)
    empty, rated = section.brown_out_voltage, section.rated_voltage
    charge = (supply.voltage**2 - empty**2) / (rated**2 - empty**2)
    assert later.charge[0] <= max(0.0, charge) <= later.charge[1] + 1e-12


def test_kept_charge_narrows_little_in_an_hour_and_is_nothing_after_a_year() -> None:
    supply, manager = made(start_voltage=3.5)
    manager.watch(supply.code(), IDLE)
    record = manager.rest((0, 0))
    for seconds, share in ((3600, 0.95), (365 * 86_400, 0.0)):
        _, later = made()
        later.recall(record, (seconds * SECOND, seconds * SECOND))
        assert share * manager.stored[0] <= later.stored[0] <= manager.stored[0]
    assert later.stored[0] < 1e-9


def assert_encloses(supply: Supply, manager: EnergyManager, begin: Flows, stored: float) -> None:
    full = supply.energy * (1.0 + 1e-12)
    assert manager.stored[0] <= full
    assert supply.energy <= manager.stored[1] * (1.0 + 1e-12)
    if manager._lasted == 0:
        net = supply.energy - stored + supply.flows.shunted - begin.shunted
        assert manager.verdict in ((CERTAIN, POSSIBLE) if net >= 0.0 else (POSSIBLE, IMPOSSIBLE))
        return
    spent = supply.flows.spent - begin.spent
    harvested = supply.flows.harvested - begin.harvested
    slack = 1e-12 * (1.0 + abs(supply.energy))
    lost = supply.flows.leaked + supply.flows.burnt - begin.leaked - begin.burnt
    assert manager._lost[0] - slack <= lost <= manager._lost[1] + slack
    assert manager.spent[0] - slack <= spent <= manager.spent[1] + slack
    assert manager.harvested[0] - slack <= harvested <= manager.harvested[1] + slack


def test_energy_is_conserved() -> None:
    supply, manager = made(start_voltage=3.79)
    first = supply.energy
    live(supply, manager, busy(10**6, 500, 2000, 100), 5e-3, 200)
    flows = supply.flows
    out = flows.spent + flows.leaked + flows.burnt + flows.shunted
    assert flows.shunted > 0.0
    assert min(flows.spent, flows.leaked, flows.burnt) > 0.0
    assert supply.energy - first == pytest.approx(flows.harvested - out, abs=1e-12)


@pytest.mark.parametrize(("share", "verdict"), [(0.0, IMPOSSIBLE), (1.0, POSSIBLE), (2.0, CERTAIN)])
def test_verdict_compares_harvest_with_consumption(share: float, verdict: int) -> None:
    supply, manager = made(start_voltage=3.0, horizon_s=20.0)
    work = busy(10**5, 250, 1500)
    live(supply, manager, work, 0.0, 1)
    flows = supply.flows
    consumed = flows.spent + flows.leaked + flows.burnt
    live(supply, manager, work, share * consumed, 80)
    assert manager.verdict == verdict


def test_full_supercapacitor_leaves_the_harvest_open_above() -> None:
    supply, manager = made(start_voltage=3.8, horizon_s=100.0)
    live(supply, manager, IDLE, 1e-3, 40)
    assert manager.harvested[1] == float("inf")
    assert manager.verdict == POSSIBLE


def test_verdict_of_three() -> None:
    assert [thrice(0.0, 1.0), thrice(-1.0, 0.0), thrice(-2.0, -1.0)] == [
        CERTAIN,
        POSSIBLE,
        IMPOSSIBLE,
    ]


def test_load_is_shed_in_stages_before_brown_out_and_taken_up_with_hysteresis() -> None:
    supply, manager = made(start_voltage=3.6)
    work = busy(10**6, 1000, 8000)
    stages, charges = [], []
    while not supply.failing and manager.stage < SLEEP:
        live(supply, manager, work, 0.0, 1)
        stages.append(manager.stage)
        charges.append(manager.charge[0])
    assert not supply.failing
    assert sorted(set(stages)) == [FULL, ADAPTIVE, PEAKS, SLEEP]
    assert stages == sorted(stages)
    assert charges[stages.index(ADAPTIVE)] < 0.5 <= charges[stages.index(ADAPTIVE) - 1]
    again = []
    while manager.stage > FULL:
        live(supply, manager, IDLE, 2e-3, 1)
        again.append((manager.stage, manager.charge[0]))
    assert [stage for stage, _ in again] == sorted((s for s, _ in again), reverse=True)
    woken = next(charge for stage, charge in again if stage == PEAKS)
    assert woken > 0.15 + 0.05


def test_brown_out_and_recovery_have_their_thresholds() -> None:
    supply, _ = made(start_voltage=2.3)
    heavy = busy(10**7, 10_000, 20_000)
    while not supply.failing:
        assert supply.voltage >= 2.2
        supply.pass_span(heavy, 0.0)
    voltages = [supply.voltage]
    while not supply.restored:
        supply.pass_span(IDLE, 1e-3)
        voltages.append(supply.voltage)
    assert voltages[0] < 2.2
    assert voltages[-2] < 2.6 <= voltages[-1]
