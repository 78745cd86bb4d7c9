"""The chain of a touched plate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.kinds.rc import RcFrontend

if TYPE_CHECKING:
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.touch.settings import TouchSection


class TouchFrontend(RcFrontend):
    """The chain of Fig. 3, without noise: the touch is disturbed at the plate, not behind it."""

    def __init__(self, taxel: TouchSection, random: ColumnGenerator) -> None:
        super().__init__(taxel, random)
        self._noise = None
