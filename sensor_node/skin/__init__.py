"""A skin: taxels side by side, where they sit, what they do to each other, and which are broken."""

from __future__ import annotations

from sensor_node.skin.crosstalk import Crosstalk, unmix
from sensor_node.skin.fault import FaultSection, break_off
from sensor_node.skin.shapes import CylinderShape, FlatShape, HandShape, Shape
from sensor_node.skin.skin import Skin

__all__ = [
    "Crosstalk",
    "CylinderShape",
    "FaultSection",
    "FlatShape",
    "HandShape",
    "Shape",
    "Skin",
    "break_off",
    "unmix",
]
