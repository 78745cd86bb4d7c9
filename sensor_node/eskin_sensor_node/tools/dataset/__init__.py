"""Labelled datasets: scenarios played with many seeds, the truth beside the intervals."""

from __future__ import annotations

from eskin_sensor_node.tools.dataset.export import write_dataset
from eskin_sensor_node.tools.dataset.plan import Plan

__all__ = ["Plan", "write_dataset"]
