"""A press over the seams of a skin that four nodes share, each with a clock of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

from tests.unit.sensor_node.columns.skins import columns_of, whole
from tests.unit.sensor_node.designs import SECOND, settings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from eskin_sensor_node.settings import NodeSettings
    from eskin_sensor_node.world.skin import Skin

    from eskin.interval import Floats

    Design = Callable[[str, tuple[str, ...]], NodeSettings]
    Sampled = dict[str, tuple[Floats, Floats, Floats]]

NODES = ("n1", "n2", "n3", "n4")


def sampled(design: NodeSettings, begin: int, end: int, *, drift: int = 0) -> Sampled:
    """Bounds and truth of each taxel of a node, between two ticks."""
    columns = columns_of(design, drift=drift)
    columns.skip(begin)
    lo, hi, truth = whole(columns, columns.advance(end))
    names = sorted(columns.columns)
    return {name: (lo[:, k], hi[:, k], truth[:, k]) for k, name in enumerate(names)}


def share(design: Design, begin: int, end: int) -> tuple[Sampled, dict[str, str]]:
    """What four nodes sample of a skin, and which of them has each taxel."""
    found: Sampled = {}
    owner: dict[str, str] = {}
    for number, node in enumerate(NODES):
        mine = sampled(design(node, NODES), begin, end, drift=7000 * (number - 2))
        owner |= dict.fromkeys(mine, node)
        found |= mine
    return found, owner


def at_seams(skin: Skin, owner: dict[str, str]) -> set[str]:
    """The taxels with a neighbour that another node samples."""
    return {
        name
        for name in owner
        for other in skin.neighbours[skin.numbers[name]].tolist()
        if other != NO_NEIGHBOUR and owner[skin.names[other]] != owner[name]
    }


def require_enclosed(found: Iterable[tuple[Floats, Floats, Floats]]) -> None:
    for lo, hi, truth in found:
        assert np.all((lo <= truth) & (truth <= hi))


def width(of: tuple[Floats, Floats, Floats]) -> float:
    return float(np.mean(of[1] - of[0]))


def test_grip_over_a_seam_is_enclosed_and_one_node_would_know_more(tmp_path: Path) -> None:
    def design(node: str, nodes: tuple[str, ...]) -> NodeSettings:
        skin = {"controllers": nodes}
        return settings(tmp_path, "small-hand", node={"name": node}, skin=skin)

    begin, end = 11 * SECOND, 13 * SECOND  # of the scenario's grip
    found, owner = share(design, begin, end)
    alone = sampled(design("n1", ("n1",)), begin, end)
    assert found.keys() == alone.keys()
    require_enclosed(found.values())
    seams = at_seams(settings(tmp_path, "small-hand").skin.skin, owner)
    pressed = {name for name in seams if found[name][2].max() > 3e3}
    assert len({owner[name] for name in pressed}) > 1, "the grip lies over a seam"
    for name in pressed:
        assert width(found[name]) > 1.01 * width(alone[name])
    for name in found.keys() - seams:
        assert abs(width(found[name]) - width(alone[name])) < 0.01 * width(alone[name])
