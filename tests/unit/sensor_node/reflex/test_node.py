"""Reflexes of an emulated node: in time, by the codes that it stores, and by nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.node.commands import NodeControls
from eskin_sensor_node.node.reflexes import MOST_WORK_NS

from eskin.errors import MonitorError, SettingsError
from eskin.interval import Verdict
from eskin.wire.frames import Because, MonitorVerdict, Statements
from eskin.wire.messages import ResetCause
from tests.unit.sensor_node.designs import SECOND, Bench, table
from tests.unit.sensor_node.messages import decode, samples_of

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.wire.messages.command import Arguments

CHANNEL = "t01.capacitance"
FORMULA = f"{CHANNEL} > 50 pF"


def monitor(formula: str = FORMULA, **changes: str) -> dict[str, str]:
    return {"name": "squeeze", "formula": formula, "on": "possible", "output": "stop"} | changes


def verdicts_of(bench: Bench) -> list[MonitorVerdict]:
    messages = [decode(body) for body in bench.bodies()]
    return [each for one in messages if isinstance(one, Statements) for each in one.verdicts]


def test_output_follows_each_sample_within_a_period(tmp_path: Path) -> None:
    bench = Bench(tmp_path, monitor=[monitor()])
    bench.run_to(3.0)
    edges = [*bench.node.machine.outputs.edges]
    period = bench.node.taxels[0].control_unit.schedule.dt
    assert len(edges) > 5
    for edge in edges:
        assert 0 < edge.time - edge.cause <= min(period, MOST_WORK_NS)
    stated = verdicts_of(bench)
    found = [each.verdict is not Verdict.IMPOSSIBLE for each in stated]
    changes = [
        level for level, before in zip(found, [False, *found], strict=False) if level != before
    ]
    assert [edge.level for edge in edges][: len(changes)] == changes
    assert {each.verdict for each in stated} == set(Verdict)
    assert all(bool(each.because) is (each.verdict is Verdict.POSSIBLE) for each in stated)
    bench.close()


def levels(bench: Bench, samples: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Whether the output was on after each sample of the first taxel."""
    taxel = bench.node.taxels[0]
    dt = taxel.control_unit.schedule.dt
    found = np.zeros(samples, bool)
    for edge in bench.node.machine.outputs.edges:
        found[(edge.cause - bench.node.machine.booted) // dt :] = edge.level
    return found


@pytest.mark.parametrize("on", ["possible", "certain"])
def test_no_true_violation_is_missed_and_none_is_invented(tmp_path: Path, on: str) -> None:
    bench = Bench(tmp_path, monitor=[monitor(on=on)])
    bench.run_to(6.0)
    violated = np.concatenate([each.truth for each in samples_of(bench, CHANNEL)]) > 50e-12
    acted = levels(bench, len(violated))
    assert 0.2 < violated.mean() < 0.8
    if on == "possible":
        assert not (violated & ~acted).any()
    else:
        assert not (acted & ~violated).any()
    # It is no trivial answer: both agree but near the threshold.
    assert (acted == violated).mean() > 0.97
    bench.close()


@pytest.mark.parametrize(
    ("formula", "names"),
    [
        pytest.param("p.pressure > 1.5 kPa", "p", marks=pytest.mark.nightly),
        ("max(p.pressure, q.pressure) - 1 kPa > 500 Pa", "pq"),
    ],
)
def test_pressure_is_measured_at_each_sample(tmp_path: Path, formula: str, names: str) -> None:
    air = [table(kind, scenario="hand.toml") for kind in ("thermometer", "hygrometer")]
    along = {each["kind"]: each["id"] for each in air}
    pads = [
        table("pad", id=name, place=place, **along)
        for name, place in (("p", "t05"), ("q", "t06"), ("r", "t09"))
    ]
    bench = Bench(tmp_path, "hand", taxel=[*pads, *air], monitor=[monitor(formula, on="certain")])
    bench.run_to(20.0)
    tubes = [samples_of(bench, f"{name}.pressure") for name in names]
    lo, hi = (
        np.max(
            [np.concatenate([getattr(each.tube.values, end) for each in own]) for own in tubes], 0
        )
        for end in ("inf", "sup")
    )
    acted = levels(bench, len(lo))
    # Frames are rounded outward by a quantum, 1/64 of the least width: between, either may be.
    width = float((hi - lo).min()) / 16
    assert not acted[lo < 1.5e3 - width].any()
    assert acted[lo > 1.5e3 + width].all()
    assert 20 < acted.sum() < len(acted) - 20
    bench.close()


def test_a_command_sets_a_monitor_which_survives_a_reset(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    controls = NodeControls(bench.node)
    controls.restore({})
    state = controls.apply(
        "monitor", {"monitor": "squeeze", "formula": FORMULA, "on": "certain", "output": "out1"}
    )
    assert state["monitor:squeeze"] == {"formula": FORMULA, "on": "certain", "output": "out1"}
    bench.run_to(1.0)
    assert {edge.output for edge in bench.node.machine.outputs.edges} == {"out1"}
    again = NodeControls(bench.node)
    bench.node.reflexes.reset()
    assert bench.node.reflexes.definitions == {}
    assert again.restore(state)["monitor:squeeze"] == state["monitor:squeeze"]
    assert "monitor:squeeze" not in again.apply("monitor", {"monitor": "squeeze", "on": "never"})
    bench.close()


def test_a_monitor_of_the_settings_stays_removed_until_a_reset(tmp_path: Path) -> None:
    bench = Bench(tmp_path, monitor=[monitor()])
    controls = NodeControls(bench.node)
    state = controls.apply("monitor", {"monitor": "squeeze", "on": "never"})
    assert state["monitor:squeeze"] == {"on": "never"}
    bench.node.reflexes.reset()
    assert controls.restore(state)["monitor:squeeze"] == {"on": "never"}
    assert controls.apply("reset", {})["monitor:squeeze"]["formula"] == FORMULA
    bench.close()


REFUSED = [
    "t01.capacitance >",
    "t09.capacitance > 1 pF",
    "t01.capacitance > 1 V",
    "eventually[0,1s] t01.capacitance > 1 pF",
    "once t01.capacitance > 1 pF",
    "t01.capacitance * t02.capacitance > 1",
    "t01.capacitance * t01.current > 1",
    "once[1h,2h] t01.capacitance > 1 pF",
    " or ".join(f"once[{k}ms,{k + 1}ms] rise(t01.capacitance > {k} pF)" for k in range(1, 20)),
]


@pytest.mark.parametrize("formula", REFUSED)
def test_what_a_node_cannot_run_is_refused_and_changes_nothing(
    tmp_path: Path, formula: str
) -> None:
    bench = Bench(tmp_path, monitor=[monitor()])
    controls = NodeControls(bench.node)
    before = bench.node.reflexes.definitions
    with pytest.raises(MonitorError):
        controls.apply(
            "monitor", {"monitor": "other", "formula": formula, "on": "certain", "output": "none"}
        )
    assert bench.node.reflexes.definitions == before
    with pytest.raises(SettingsError):
        Bench(tmp_path / "own", monitor=[monitor(formula)])
    bench.close()


def test_a_reset_of_the_machine_turns_outputs_off(tmp_path: Path) -> None:
    bench = Bench(tmp_path, monitor=[monitor(f"{CHANNEL} > 1 pF")])
    bench.run_to(0.5)
    machine = bench.node.machine
    assert machine.outputs.is_on("stop")
    machine.reset(ResetCause.WATCHDOG)
    assert not machine.outputs.is_on("stop")
    bench.run_to(1.0)
    assert machine.outputs.is_on("stop")
    bench.close()


def test_verdicts_after_missing_samples_name_the_gap(tmp_path: Path) -> None:
    bench = Bench(tmp_path, monitor=[monitor(f"historically[0,500ms] {CHANNEL} < 1 nF")])
    bench.run_to(1.0)
    bench.ticks = 4 * SECOND
    bench.node.advance(bench.ticks)
    bench.run_to(5.0)
    verdicts = verdicts_of(bench)
    found = [each.verdict for each in verdicts]
    assert found == [Verdict.POSSIBLE, Verdict.CERTAIN, Verdict.POSSIBLE, Verdict.CERTAIN]
    assert all(Because.GAP in each.because for each in verdicts[::2])
    bench.close()


def test_a_machine_that_would_become_too_slow_refuses(tmp_path: Path) -> None:
    bench = Bench(tmp_path, machine={"clock_hz": 40_000_000})
    controls = NodeControls(bench.node)
    some = " or ".join(f"once[0,{k}ms] {CHANNEL} > {k} pF" for k in range(20, 28))
    with pytest.raises(MonitorError) as refused:
        controls.apply(
            "monitor", {"monitor": "m", "formula": some, "on": "certain", "output": "none"}
        )
    assert isinstance(refused.value.value, int)
    simple: Arguments = {"monitor": "m", "formula": FORMULA, "on": "certain", "output": "none"}
    assert "monitor:m" in controls.apply("monitor", simple)
    bench.close()
