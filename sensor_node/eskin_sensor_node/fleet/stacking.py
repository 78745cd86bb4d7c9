"""Many nodes in one object: columns of true parts, and of random numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Frontend

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from eskin.interval import Floats

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


class StackedGenerator(np.random.Generator):
    """Draws what each of its generators would draw alone.

    Args:
        seeds: One for each generator.
    """

    def __init__(self, seeds: Iterable[tuple[int, ...]]) -> None:
        self.generators = [np.random.default_rng(seed) for seed in seeds]
        super().__init__(self.generators[0].bit_generator)

    def uniform(self, low: float, high: float, size: tuple[int, int]) -> Floats:  # type: ignore[override]  # only what noise needs
        """Uniform numbers of shape (generators, n)."""
        drawn = np.empty(size)
        for row, generator in zip(drawn, self.generators, strict=True):
            row[:] = generator.uniform(low, high, size[1])
        return drawn

    def normal(self, loc: float, scale: float, size: tuple[int, int]) -> Floats:  # type: ignore[override]  # likewise
        """Gaussian numbers of shape (generators, n)."""
        drawn = np.empty(size)
        for row, generator in zip(drawn, self.generators, strict=True):
            row[:] = generator.normal(loc, scale, size[1])
        return drawn
