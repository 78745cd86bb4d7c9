"""What a node's design spends and harvests, from its firmware running as fast as it can."""

from eskin_sensor_node.tools.budget.budget import Budget, conditions, saving
from eskin_sensor_node.tools.budget.design import NodeDesign

__all__ = ["Budget", "NodeDesign", "conditions", "saving"]
