"""The ``[skin]`` table: what is refused, and what a machine cannot hold or compute."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from eskin_sensor_node.machine.budget import ram_budget, require_flash, require_ram
from eskin_sensor_node.machine.processor import processor_load, require_speed
from eskin_sensor_node.profile import Profile
from pydantic import ValidationError

from eskin.errors import SettingsError
from tests.unit.sensor_node.columns.skins import flat
from tests.unit.sensor_node.designs import settings, table

if TYPE_CHECKING:
    from pathlib import Path

KIB = 1024
STM32U575 = {
    "processor": "cortex-m33",
    "cores": 1,
    "clock_hz": 160_000_000,
    "ram_bytes": 784 * KIB,
    "flash_bytes": 2048 * KIB,
}

REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"scenario": "none.toml"}, "none.toml"),
    ({"sampling_hz": 33.0}, "stretch_ms"),
    ({"stretch_ms": 10.0}, "stretch_ms"),
    ({"stretch_ms": 105.0}, "stretch_ms"),
    ({"threshold_pa": 0.0}, "threshold_pa"),
    ({"controllers": ("a", "a")}, "twice"),
    ({"controllers": ("a", "b")}, "does not name"),
    ({"pad": {}}, "pad.noise is missing"),
    ({"pad": {"typo": 1.0}}, "pad"),
    ({"thermometer": {"noise": {"kind": "none"}}}, "thermometer.noise"),
    ({"nothing": 1}, "nothing"),
]


@pytest.mark.parametrize(("changes", "place"), REFUSED)
def test_what_cannot_be_sampled_is_refused_with_its_place(
    changes: dict[str, Any], place: str, tmp_path: Path
) -> None:
    with pytest.raises(ValidationError, match=place):
        settings(tmp_path, "small-hand", skin=changes)


@pytest.mark.parametrize(
    ("key", "value"), [("adaptive", True), ("actuator_steps", 2), ("id", "t01"), ("place", "t01")]
)
def test_a_pad_s_keys_that_a_skin_does_not_have_are_refused(
    key: str, value: object, tmp_path: Path
) -> None:
    pad = settings(tmp_path, "small-hand").skin.pad | {key: value}
    with pytest.raises(ValidationError, match=f"pad.{key}"):
        settings(tmp_path, "small-hand", skin={"pad": pad})


def test_a_node_has_taxels_or_a_skin_and_a_fleet_has_none(tmp_path: Path) -> None:
    small_hand = Profile.read("small-hand").sections["skin"]
    with pytest.raises(ValidationError, match="either"):
        settings(tmp_path, "nothing")
    with pytest.raises(ValidationError, match="either"):
        settings(tmp_path, "nothing", skin=small_hand, taxel=[table("touch")])
    with pytest.raises(ValidationError, match="fleet"):
        settings(tmp_path, "small-hand", fleet={"count": 2})


def test_more_stuck_neighbours_than_a_pad_allows_for_are_refused(tmp_path: Path) -> None:
    faults = "".join(
        f'[[fault]]\ntaxel = "{name}"\nkind = "stuck"\nat_s = 1.0\n' for name in ("t01", "t06")
    )
    with pytest.raises(ValidationError, match="doubtful_neighbours"):
        flat(tmp_path, 5, 6, faults=faults)


@pytest.mark.parametrize("hertz", [50.0, 100.0])
def test_the_packaged_machine_holds_and_computes_the_paper_s_hand(
    hertz: float, tmp_path: Path
) -> None:
    node = settings(tmp_path, "paper-hand", skin={"sampling_hz": hertz})
    require_ram(node)
    require_flash(node)
    require_speed(node, {})
    # A skin's work grows with its samples.
    assert node.skin is not None
    slower = {"sampling_hz": hertz / 2, "stretch_ms": 2.0 * node.skin.stretch_ms}
    half = settings(tmp_path, "paper-hand", skin=slower)
    ratio = processor_load(node, {}).total / processor_load(half, {}).total
    assert 1.9 < ratio <= 2.0


def test_a_microcontroller_does_not_hold_the_paper_s_hand_and_says_so(tmp_path: Path) -> None:
    node = settings(tmp_path, "paper-hand", machine=STM32U575)
    with pytest.raises(SettingsError, match=str(ram_budget(node).total)):
        require_ram(node)
    with pytest.raises(SettingsError, match=str(processor_load(node, {}).total)):
        require_speed(node, {})


def test_a_microcontroller_holds_some_hundred_taxels(tmp_path: Path) -> None:
    node = settings(tmp_path, "small-hand", machine=STM32U575, skin={"sampling_hz": 10.0})
    require_ram(node)
    require_speed(node, {})


def test_all_cores_share_a_skin(tmp_path: Path) -> None:
    one = settings(tmp_path, "paper-hand", skin={"sampling_hz": 100.0}, machine={"cores": 1})
    with pytest.raises(SettingsError, match=r"machine\.clock_hz"):
        require_speed(one, {})


def test_nodes_that_share_a_skin_need_less_each(tmp_path: Path) -> None:
    whole = settings(tmp_path, "paper-hand")
    share = settings(
        tmp_path,
        "paper-hand",
        node={"name": "n2"},
        skin={"controllers": ("n1", "n2", "n3", "n4")},
    )
    assert ram_budget(share).bounds < 0.26 * ram_budget(whole).bounds
    assert processor_load(share, {}).total < 0.26 * processor_load(whole, {}).total
