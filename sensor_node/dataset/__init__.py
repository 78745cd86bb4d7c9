"""Labelled datasets: scenarios played with many seeds, the truth beside the intervals."""

from __future__ import annotations

from sensor_node.dataset.export import write_dataset
from sensor_node.dataset.plan import Plan

__all__ = ["Plan", "write_dataset"]
