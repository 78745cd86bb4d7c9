"""A skin: taxels side by side, where they sit, what they do to each other, and which are broken."""

from __future__ import annotations

from eskin_sensor_node.world.skin.crosstalk import Crosstalk, unmix
from eskin_sensor_node.world.skin.fault import FaultSection, break_off, placed
from eskin_sensor_node.world.skin.shapes import CylinderShape, FlatShape, HandShape, Shape
from eskin_sensor_node.world.skin.skin import Skin
from eskin_sensor_node.world.skin.wear import (
    FilmSection,
    HysteresisSection,
    WearSection,
    drifted,
    wet,
    worn,
)

__all__ = [
    "Crosstalk",
    "CylinderShape",
    "FaultSection",
    "FilmSection",
    "FlatShape",
    "HandShape",
    "HysteresisSection",
    "Shape",
    "Skin",
    "WearSection",
    "break_off",
    "drifted",
    "placed",
    "unmix",
    "wet",
    "worn",
]
