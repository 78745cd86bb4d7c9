"""Noise as a data sheet states it: what the firmware may assume, and what the world draws."""

from __future__ import annotations

import math
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from eskin.noise import coverage_within
from eskin.runtime.settings import Section


class UniformNoise(Section):
    """Noise with a hard bound: an enclosure may claim coverage 1."""

    kind: Literal["uniform"]
    bound: float = Field(ge=0, description="greatest size, in the unit of the disturbed quantity")

    @property
    def reach(self) -> float:
        """How far the noise may move a value, as far as the coverage says."""
        return self.bound

    @property
    def coverage(self) -> float:
        """Probability that it stays within its reach."""
        return 1.0


class GaussianNoise(Section):
    """Unbounded noise: an enclosure of k standard deviations holds with a stated coverage."""

    kind: Literal["gaussian"]
    sigma: float = Field(gt=0, description="standard deviation, in the disturbed quantity's unit")
    k: float = Field(default=6.0, ge=1, le=8, description="standard deviations that are enclosed")

    @property
    def reach(self) -> float:
        """The enclosed standard deviations, rounded up."""
        return math.nextafter(self.k * self.sigma, math.inf)

    @property
    def coverage(self) -> float:
        """``1 - erfc(k/√2)``, rounded down."""
        return coverage_within(self.k)


Noise: TypeAlias = Annotated[UniformNoise | GaussianNoise, Field(discriminator="kind")]
"""One of the two, which ``kind`` names."""
