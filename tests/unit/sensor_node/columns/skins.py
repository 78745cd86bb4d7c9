"""Skins for tests: a packaged small hand, or a flat skin with a scenario of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from eskin_sensor_node.columns import build
from eskin_sensor_node.profile import Profile

from tests.unit.sensor_node.designs import clock_at, settings

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from eskin_sensor_node.columns import PadColumns, SkinStretch
    from eskin_sensor_node.settings import NodeSettings

    from eskin.interval import Floats

FLAT = """
description = "a press on a flat skin"
duration_s = 4.0
repeat = true
[skin]
shape = "flat"
rows = {rows}
columns = {columns}
pitch_m = 5e-3
crosstalk = 0.1
[[event]]
kind = "press"
at = "t{at}"
at_s = 0.2
duration_s = 3.0
force_N = 2.0
radius_m = 9e-3
"""
SEED = 7


def flat(
    folder: Path,
    rows: int,
    columns: int,
    *,
    node: str = "small-hand",
    faults: str = "",
    **skin: Any,
) -> NodeSettings:
    """A flat skin of the small hand's pads."""
    path = folder / f"flat-{rows}-{columns}.toml"
    middle = rows // 2 * columns + columns // 2
    digits = max(2, len(str(rows * columns - 1)))
    path.write_text(FLAT.format(rows=rows, columns=columns, at=f"{middle:0{digits}d}") + faults)
    section = Profile.read("small-hand").sections["skin"] | {"scenario": str(path)} | skin
    return settings(folder, "small-hand", node={"name": node}, skin=section)


def columns_of(
    node: NodeSettings, *, seed: int = SEED, boot: int = 0, drift: int = 0
) -> PadColumns:
    """The columns of a node's skin, with a clock at its start."""
    return build(node, seed, boot=boot, clock=clock_at(lambda: 0, drift=drift))


def whole(columns: PadColumns, stretches: Iterable[SkinStretch]) -> tuple[Floats, Floats, Floats]:
    """Lower and upper bounds and truth of some stretches: rows × taxels in their order."""
    kept = list(stretches)
    names = [name for each in kept[0].patches for name in columns.patches[each.patch].taxels]
    order = np.argsort(names)
    parts = [
        [np.concatenate([getattr(p, part) for p in s.patches], axis=1) for s in kept]
        for part in ("lo", "hi", "truth")
    ]
    lo, hi, truth = (np.concatenate(each)[:, order] for each in parts)
    return lo, hi, truth
