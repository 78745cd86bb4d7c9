"""Compiles what the packaged nodes use, alone and as a fleet."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final

from eskin_sensor_node.fleet.service import warm_up as warm_up_fleet
from eskin_sensor_node.node.offline import warm_up
from eskin_sensor_node.profile import profile_names
from eskin_sensor_node.tools.budget import Design

if TYPE_CHECKING:
    from collections.abc import Callable


def _rehearse(profile: str) -> None:
    warm_up(Design.named(profile).settings)


def _fleets() -> None:
    """Their nodes measure into columns of arrays, which are other types."""
    for profile in profile_names():
        warm_up_fleet(Design.named(profile).settings)


STEPS: Final[dict[str, Callable[[], object]]] = {
    f"the node {name}": partial(_rehearse, name) for name in profile_names()
} | {"fleets of nodes": _fleets}
"""What is compiled, and what uses each of its kernels once."""
