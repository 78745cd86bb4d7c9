"""One object for many: the same code works on columns of true parts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Frontend

if TYPE_CHECKING:
    from collections.abc import Sequence

Kind = TypeVar("Kind")


def stacked(alike: Sequence[Kind]) -> Kind:
    """Stack objects of one class and one design into a single one.

    Where their numbers differ, the result has a column of them, of shape ``(objects, 1)``; numpy
    then calculates row by row what each object would have, operation by operation, so that not a
    bit differs. What is the same in all is taken from the first.

    Args:
        alike: What a design drew for each node.
    """
    made = object.__new__(type(alike[0]))
    for name in vars(alike[0]):
        setattr(made, name, _stacked([vars(each)[name] for each in alike]))
    return made


def _stacked(values: list[Any]) -> Any:
    first = values[0]
    if isinstance(first, Converter | Frontend):
        return stacked(values)
    if isinstance(first, dict):
        return {key: _stacked([value[key] for value in values]) for key in first}
    if isinstance(first, float) and any(value != first for value in values):
        return np.array(values)[:, None]
    return first
