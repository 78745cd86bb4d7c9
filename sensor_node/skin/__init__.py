"""A skin: taxels side by side, where they sit, and what they do to each other."""

from __future__ import annotations

from sensor_node.skin.shapes import CylinderShape, FlatShape, HandShape, Shape
from sensor_node.skin.skin import Skin

__all__ = ["CylinderShape", "FlatShape", "HandShape", "Shape", "Skin"]
