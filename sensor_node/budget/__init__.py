"""What a node's design spends and harvests, from its firmware running as fast as it can."""

from sensor_node.budget.budget import Budget, saving
from sensor_node.budget.conditions import conditions
from sensor_node.budget.design import Design, design_names

__all__ = ["Budget", "Design", "conditions", "design_names", "saving"]
