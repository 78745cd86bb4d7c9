"""Taxels of one kind as columns of arrays: a large skin is sampled at once."""

from __future__ import annotations

from eskin_sensor_node.columns.factory import build
from eskin_sensor_node.columns.pad_columns import Fault, PadColumns
from eskin_sensor_node.columns.stretch import PatchColumns, SkinColumns, SkinStretch

__all__ = ["Fault", "PadColumns", "PatchColumns", "SkinColumns", "SkinStretch", "build"]
