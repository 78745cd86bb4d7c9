"""Many random generators that draw together, each its own row."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eskin.interval import Floats


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
