"""Many random generators that draw together, each its own row."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eskin.interval import Floats


class Choir(np.random.Generator):
    """Draws what each of its voices would draw alone.

    Args:
        seeds: One for each voice.
    """

    def __init__(self, seeds: Iterable[tuple[int, ...]]) -> None:
        self.voices = [np.random.default_rng(seed) for seed in seeds]
        super().__init__(self.voices[0].bit_generator)

    def uniform(self, low: float, high: float, size: tuple[int, int]) -> Floats:  # type: ignore[override]  # only what noise needs
        """Uniform numbers of shape (voices, n)."""
        drawn = np.empty(size)
        for row, voice in zip(drawn, self.voices, strict=True):
            row[:] = voice.uniform(low, high, size[1])
        return drawn

    def normal(self, loc: float, scale: float, size: tuple[int, int]) -> Floats:  # type: ignore[override]  # likewise
        """Gaussian numbers of shape (voices, n)."""
        drawn = np.empty(size)
        for row, voice in zip(drawn, self.voices, strict=True):
            row[:] = voice.normal(loc, scale, size[1])
        return drawn
