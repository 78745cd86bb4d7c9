"""Compiles the kernels of the packaged nodes, alone and as a fleet."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final

from eskin_sensor_node.fleet.service import warm_up as warm_up_fleet
from eskin_sensor_node.node.offline import warm_up
from eskin_sensor_node.profile import profile_names
from eskin_sensor_node.tools.budget import NodeDesign
from eskin_sensor_node.tools.budget.skin_work import skin_work

if TYPE_CHECKING:
    from collections.abc import Callable


def _warm_up_node(profile: str) -> None:
    settings = NodeDesign.named(profile).settings
    if settings.skin.present:
        skin_work(settings, 1, lambda _: None)
    else:
        warm_up(settings)


def _warm_up_fleets() -> None:
    """Their nodes measure into columns of arrays, which are other types."""
    for profile in profile_names():
        settings = NodeDesign.named(profile).settings
        if not settings.skin.present:
            warm_up_fleet(settings)


STEPS: Final[dict[str, Callable[[], object]]] = {
    f"the node {name}": partial(_warm_up_node, name) for name in profile_names()
} | {"fleets of nodes": _warm_up_fleets}
"""What is compiled, and what uses each of its kernels once."""
