"""A press over the seams of a skin that four nodes share, each with a clock of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

from tests.unit.sensor_node.columns.skins import columns_of, whole
from tests.unit.sensor_node.designs import SECOND, settings

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.columns import PadColumns

    from eskin.interval import Floats

NODES = ("n1", "n2", "n3", "n4")
BEGIN, END = 11 * SECOND, 13 * SECOND
"""While the scenario of the small hand holds a grip."""


def share(folder: Path, node: str, nodes: tuple[str, ...], *, drift: int = 0) -> PadColumns:
    design = settings(
        folder, "small-hand", node={"name": node}, skin={"controllers": nodes, "threshold_pa": 3e3}
    )
    return columns_of(design, drift=drift)


def sampled(columns: PadColumns) -> dict[str, tuple[Floats, Floats, Floats]]:
    """Bounds and truth of each taxel during the grip."""
    columns.skip(BEGIN)
    lo, hi, truth = whole(columns, columns.advance(END))
    names = sorted(columns.columns)
    return {name: (lo[:, k], hi[:, k], truth[:, k]) for k, name in enumerate(names)}


def test_pressures_at_seams_enclose_the_truth_that_other_nodes_hand_on(tmp_path: Path) -> None:
    alone = sampled(share(tmp_path, "n1", ("n1",)))
    owner: dict[str, str] = {}
    found: dict[str, tuple[Floats, Floats, Floats]] = {}
    for number, node in enumerate(NODES):
        mine = sampled(share(tmp_path, node, NODES, drift=7000 * (number - 2)))
        owner |= dict.fromkeys(mine, node)
        found |= mine
    assert found.keys() == alone.keys()
    for lo, hi, truth in found.values():
        assert np.all((lo <= truth) & (truth <= hi))
    skin = settings(tmp_path, "small-hand").skin.skin
    seams = {
        name
        for name in found
        for other in skin.neighbours[skin.numbers[name]].tolist()
        if other != NO_NEIGHBOUR and owner[skin.names[other]] != owner[name]
    }
    pressed = {name for name in seams if found[name][2].max() > 3e3}
    assert len({owner[name] for name in pressed}) > 1, "the grip lies over a seam"
    for name in pressed:
        here, there = (float(np.mean(of[name][1] - of[name][0])) for of in (found, alone))
        assert here > 1.01 * there, "one node would know more"
    for name in found.keys() - seams:
        here, there = (float(np.mean(of[name][1] - of[name][0])) for of in (found, alone))
        assert abs(here - there) < 0.01 * there
