"""Noise as a data sheet states it: what the firmware may assume, and what the world draws."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import Field

from eskin.settings import Section

if TYPE_CHECKING:
    from collections.abc import Iterable


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
        # erfc's own error is far below one part in 1e12.
        beyond = math.erfc(self.k / math.sqrt(2.0)) * (1.0 + 1e-12)
        return math.nextafter(1.0 - beyond, 0.0)


Noise: TypeAlias = Annotated[UniformNoise | GaussianNoise, Field(discriminator="kind")]
"""One of the two, told apart by ``kind``."""


def joint_coverage(coverages: Iterable[float]) -> float:
    """Probability that several noises stay within their reaches at once, at least (union bound)."""
    beyond = 0.0
    for coverage in coverages:
        if coverage < 1.0:
            # 1 - coverage is exact (Sterbenz) for any coverage from one half on.
            beyond = math.nextafter(beyond + (1.0 - coverage), math.inf)
    return 1.0 if beyond == 0.0 else max(0.0, math.nextafter(1.0 - beyond, 0.0))
