"""Reflexes of a skin: each column as a taxel of its own, in time, by the bounds of its frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.node.reflexes import MOST_WORK_NS

from eskin.errors import MonitorError, SettingsError
from eskin.interval import Verdict
from eskin.wire.messages import ResetCause
from tests.unit.sensor_node.columns.skins import columns_of, flat, whole
from tests.unit.sensor_node.designs import SECOND, settings
from tests.unit.sensor_node.reflex.skins import SEED, SkinBench

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.settings import NodeSettings
    from numpy.typing import NDArray

    from eskin.wire.messages.command import Arguments

MIDDLE = "t15"
"""Of five rows of six: the scenario presses there."""
FORMULA = f"{MIDDLE}.pressure > 3 kPa"


def monitor(formula: str = FORMULA, **changes: str) -> dict[str, str]:
    return {"name": "squeeze", "formula": formula, "on": "possible", "output": "stop"} | changes


def bench_of(folder: Path, *monitors: dict[str, str], **sections: Any) -> SkinBench:
    folder.mkdir(exist_ok=True)
    node = flat(folder, 5, 6)
    return SkinBench(folder, node.model_copy(update=_sections(folder, node, monitors)), **sections)


def _sections(
    folder: Path, node: NodeSettings, monitors: tuple[dict[str, str], ...]
) -> dict[str, Any]:
    checked = settings(folder, "small-hand", skin=node.skin.model_dump(), monitor=list(monitors))
    return {"monitor": checked.monitor}


def bounds_of(bench: SkinBench, taxel: str, seconds: int) -> list[NDArray[np.float64]]:
    """Lower and upper bounds of a pressure and the truth, of other columns with the same seed."""
    columns = columns_of(bench.settings, seed=SEED, boot=bench.outbox.boot)
    number = sorted(columns.columns).index(taxel)
    return [each[:, number] for each in whole(columns, columns.advance(seconds * SECOND))]


@pytest.mark.parametrize("on", ["possible", "certain"])
def test_the_output_follows_each_row_as_its_bounds_say(tmp_path: Path, on: str) -> None:
    bench = bench_of(tmp_path, monitor(on=on))
    bench.run_to(4.0)
    lo, hi, truth = bounds_of(bench, MIDDLE, 4)
    acted = bench.levels(len(lo))
    expected = lo > 3e3 if on == "certain" else hi > 3e3
    assert np.array_equal(acted, expected)
    violated = truth > 3e3
    assert not ((violated & ~acted) if on == "possible" else (acted & ~violated)).any()
    assert 20 < violated.sum() < len(violated) - 20
    bench.close()


def test_reactions_take_less_than_a_period(tmp_path: Path) -> None:
    bench = bench_of(tmp_path, monitor(f"once[0,40ms] {FORMULA}", on="certain"))
    bench.run_to(8.0)
    edges = [*bench.node.machine.outputs.edges]
    assert len(edges) >= 4
    for edge in edges:
        assert 0 < edge.time - edge.cause <= min(bench.node.columns.period, MOST_WORK_NS)
        # Long before the end of the stretch, after which frames are written.
        assert (edge.cause - bench.node.machine.booted) % bench.settings.skin.stretch != 0
    stated = bench.verdicts()
    assert {each.verdict for each in stated} >= {Verdict.IMPOSSIBLE, Verdict.CERTAIN}
    assert [
        each.verdict is Verdict.CERTAIN for each in stated if each.verdict is not Verdict.POSSIBLE
    ][1:3] == [True, False]
    bench.close()


def test_a_difference_of_two_columns_is_that_of_their_bounds(tmp_path: Path) -> None:
    bench = bench_of(tmp_path, monitor(f"{MIDDLE}.pressure - t00.pressure > 1 kPa", on="certain"))
    bench.run_to(4.0)
    (lo, _, _), (_, hi, _) = (bounds_of(bench, name, 4) for name in (MIDDLE, "t00"))
    acted = bench.levels(len(lo))
    near = np.abs(lo - hi - 1e3) < 1e-6
    assert np.array_equal(acted[~near], (lo - hi > 1e3)[~near])
    assert 20 < acted.sum() < len(acted) - 20
    bench.close()


def test_commands_set_monitors_which_survive_a_reset(tmp_path: Path) -> None:
    bench = bench_of(tmp_path)
    bench.controls.restore({})
    wanted: Arguments = {"formula": FORMULA, "on": "certain", "output": "out1"}
    state = bench.controls.apply("monitor", {"monitor": "squeeze", **wanted})
    assert state["monitor:squeeze"] == wanted
    bench.run_to(1.0)
    assert {edge.output for edge in bench.node.machine.outputs.edges} == {"out1"}
    bench.node.machine.reset(ResetCause.WATCHDOG)
    bench.run_to(1.5)
    assert "monitor:squeeze" not in bench.node.reflexes.state
    assert bench.controls.restore(state)["monitor:squeeze"] == wanted
    bench.run_to(6.0)
    assert len({edge.time for edge in bench.node.machine.outputs.edges}) > 2
    assert bench.verdicts()
    assert "monitor:squeeze" not in bench.controls.apply(
        "monitor", {"monitor": "squeeze", "on": "never"}
    )
    bench.close()


def test_another_rate_keeps_the_monitor_right(tmp_path: Path) -> None:
    bench = bench_of(tmp_path, monitor(on="certain"))
    bench.controls.restore({})
    bench.controls.apply("set", {"rate": 25.0})
    bench.run_to(4.0)
    columns = columns_of(bench.settings, seed=SEED, boot=bench.outbox.boot)
    columns.sample_every(bench.node.columns.period)
    number = sorted(columns.columns).index(MIDDLE)
    lo = whole(columns, columns.advance(4 * SECOND))[0][:, number]
    assert np.array_equal(bench.levels(len(lo)), lo > 3e3)
    bench.close()


@pytest.mark.parametrize(
    "formula",
    [
        "t99.pressure > 1 kPa",
        f"{MIDDLE}.capacitance > 1 pF",
        f"{MIDDLE}.pressure > 1 V",
        f"eventually[0,1s] {FORMULA}",
    ],
)
def test_what_a_skin_cannot_run_is_refused_and_changes_nothing(
    tmp_path: Path, formula: str
) -> None:
    bench = bench_of(tmp_path, monitor())
    before = bench.node.reflexes.state
    with pytest.raises(MonitorError):
        bench.controls.apply(
            "monitor", {"monitor": "other", "formula": formula, "on": "certain", "output": "none"}
        )
    assert bench.node.reflexes.state == before
    with pytest.raises(SettingsError):
        bench_of(tmp_path / "own", monitor(formula))
    bench.close()
