"""Scenarios for tests, written as their files are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.world.scenario import read_scenario

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.world.scenario import Script

HEAD = """\
description = "a test"
duration_s = 10.0

[skin]
shape = "flat"
rows = 3
columns = 4
pitch_m = 0.01
"""

TAP = """
[[event]]
kind = "tap"
at = "t05"
at_s = 1.0
duration_s = 0.2
force_N = 1.0
radius_m = 4e-3
"""


def write(folder: Path, text: str) -> str:
    """A scenario file."""
    path = folder / "scene.toml"
    path.write_text(text)
    return str(path)


def script(folder: Path, text: str) -> Script:
    """A scenario that is written and read."""
    return read_scenario(write(folder, text))
