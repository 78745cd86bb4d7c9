"""Prices of the firmware's work, and nodes that their processor cannot keep up with."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from eskin_sensor_node.kinds.neighbours import measured_around
from eskin_sensor_node.kinds.registry import KINDS
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.machine.prices import PRICES
from eskin_sensor_node.machine.processor import Load, processor_load, require_speed
from eskin_sensor_node.node.factory import build_node, build_outbox
from eskin_sensor_node.node.ground_truth import GroundTruth

from eskin.errors import SettingsError
from tests.robustness.cortex_m33.machine import COMPILER, EMULATOR
from tests.robustness.cortex_m33.table import Table, count
from tests.unit.sensor_node.designs import Bench, settings
from tests.unit.sensor_node.flashes import open_flash

if TYPE_CHECKING:
    from eskin_sensor_node.settings import NodeSettings

PROFILES = ["fingertip", "palm", "forearm", "hand", "sole", "sock"]


def load_of(made: NodeSettings) -> Load:
    return processor_load(made, measured_around(made.taxel))


def sampled(folder: Path, profile: str = "fingertip", **sampling: Any) -> Load:
    return load_of(settings(folder, profile, sampling=sampling))


def test_every_chain_has_a_counted_price_and_a_sane_one() -> None:
    counted = Table.read().prices
    assert {kind.chain for kind in KINDS.values()} < counted.keys()
    for name, (least, most) in counted.items():
        assert 0 <= least <= most, name
        # An instruction takes a cycle at least, and less than two on the mean.
        assert least <= PRICES[name].least <= PRICES[name].most <= 2 * most, name


@pytest.mark.parametrize("profile", PROFILES)
def test_packaged_profiles_fit_into_their_machine(profile: str, tmp_path: Path) -> None:
    made = settings(tmp_path, profile)
    require_speed(made, measured_around(made.taxel))


def test_a_node_that_its_processor_cannot_keep_up_with_is_refused_with_numbers_and_remedy(
    tmp_path: Path,
) -> None:
    slow = settings(tmp_path, "hand", machine={"clock_hz": 100_000_000})
    need = load_of(slow).total
    flash, truth = open_flash(slow.flash.path), GroundTruth(slow.truth.path, limit=10**6)
    described = plan_layout(slow).described
    outbox = build_outbox(flash, capacity=10**6, broker=slow.broker, described=described)
    with pytest.raises(SettingsError, match=r"machine\.clock_hz: 100000000 cycles") as error:
        build_node(slow, outbox=outbox, truth=truth)
    assert f"up to {need} (inversion" in str(error.value)
    assert "fewer than its 19 taxels" in str(error.value)
    enough = settings(tmp_path, "hand", machine={"clock_hz": need})
    require_speed(enough, measured_around(enough.taxel))
    flash.close()
    truth.close()


def test_load_follows_what_is_asked_for(tmp_path: Path) -> None:
    plain = sampled(tmp_path)
    assert sampled(tmp_path, stretch_ms=1000.0).messages < plain.messages
    assert plain.total == sum(plain.parts().values())
    hand = settings(tmp_path, "hand")
    around = measured_around(hand.taxel)
    alone = processor_load(hand, dict.fromkeys(around, 0))
    assert alone.inversion < load_of(hand).inversion


def test_page_of_the_node_shows_the_load_of_each_profile(tmp_path: Path) -> None:
    loads = [load_of(settings(tmp_path, profile)) for profile in PROFILES[:5]]
    page = (Path(__file__).parents[4] / "docs" / "node.md").read_text()
    for name in loads[0].parts():
        row = " | ".join(f"{load.parts()[name] / 1e6:.1f}" for load in loads)
        assert f"| {name} | {row} |" in page, name
    assert f"| **all** | {' | '.join(f'{load.total / 1e6:.1f}' for load in loads)} |" in page


@pytest.mark.nightly
@pytest.mark.parametrize("profile", PROFILES)
def test_load_bounds_a_node(profile: str, tmp_path: Path) -> None:
    bench = Bench(tmp_path, profile, energy={"on": False})
    for taxel in bench.node.taxels:
        taxel.control_unit.calibrate()
    seconds = 10
    bench.run_to(float(seconds))
    work = bench.node.machine.ledger.take(bench.ticks)
    assert 0 < work.cycles < seconds * load_of(bench.settings).total
    bench.close()


@pytest.mark.nightly
@pytest.mark.skipif(
    not (shutil.which(COMPILER) and shutil.which(EMULATOR)),
    reason="needs Debian's gcc-arm-none-eabi and qemu-system-arm, which the nightly run installs",
)
def test_table_is_what_the_emulated_processor_counts() -> None:
    assert count().differences(Table.read()) == []
