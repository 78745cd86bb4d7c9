"""What the audit found of one patch."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

CONFIDENCE: Final = 1.0 - 1e-6
"""Chance brings more violations than allowed once in a million audits of a channel."""
_SUMS: Final = (
    *("frames", "samples", "violations", "mislabelled", "late", "unbounded", "forgotten"),
    *("contradictions",),
    *("width", "magnitude"),
)


@dataclass(slots=True)
class ChannelAudit:
    """Sums over the frames of one patch.

    Attributes:
        node: The node.
        channel: ``{patch}.{quantity}``.
        unit: UCUM code.
        coverage: The least that any of its frames claims.
        frames: Frames compared.
        samples: Samples compared.
        violations: Samples whose interval does not hold the truth.
        mislabelled: Frames whose columns in the store are not their own, or that are not those
            that were made.
        late: Frames whose enclosure of time does not hold the true time.
        unbounded: Samples with an unbounded side; they hold, but have no width.
        forgotten: Frames whose truth the emulator has dropped (beyond its limit).
        contradictions: Channels of the patch whose shared error no true factor explains, among
            those whose intervals always hold.
        width: Sum of the finite widths.
        magnitude: Sum of the true values' sizes, over the same samples.
    """

    node: str
    channel: str
    unit: str
    coverage: float = 1.0
    frames: int = 0
    samples: int = 0
    violations: int = 0
    mislabelled: int = 0
    late: int = 0
    unbounded: int = 0
    forgotten: int = 0
    contradictions: int = 0
    width: float = field(default=0.0)
    magnitude: float = field(default=0.0)

    def add(self, other: ChannelAudit) -> None:
        """Add the sums of other frames of the patch."""
        self.coverage = min(self.coverage, other.coverage)
        for name in _SUMS:
            setattr(self, name, getattr(self, name) + getattr(other, name))

    @property
    def bounded(self) -> int:
        """Samples with two finite sides."""
        return self.samples - self.unbounded

    @property
    def allowed(self) -> int:
        """Violations that chance may bring under the claimed coverage; 0 under bounded noise."""
        return binomial_quantile(self.samples, 1.0 - self.coverage, CONFIDENCE)

    @property
    def mean_width(self) -> float:
        """Mean of the finite widths, in the unit."""
        return self.width / self.bounded if self.bounded else float("nan")

    @property
    def relative_width(self) -> float:
        """Mean width over the mean size of the truth."""
        return self.width / self.magnitude if self.magnitude else float("nan")

    @property
    def passes(self) -> bool:
        """Whether the channel keeps its promise."""
        broken = self.late + self.mislabelled + self.contradictions
        return self.violations <= self.allowed and broken == 0


def binomial_quantile(trials: int, probability: float, confidence: float) -> int:
    """The least count k with P(X <= k) >= confidence, X binomial.

    Args:
        trials: Number of trials, at least 0.
        probability: Of a violation in one trial.
        confidence: Such as 1 - 1e-6.

    Returns:
        0 where the probability is 0.
    """
    if trials == 0 or probability <= 0.0:
        return 0
    if probability >= 1.0:
        return trials
    # Summed from the far tail would lose what matters near zero: the mass is added from 0 upward,
    # and the rest is compared with 1 - confidence.
    missing = 1.0 - confidence
    mass, count = 0.0, -1
    while count < trials and 1.0 - mass > missing:
        count += 1
        mass += math.exp(_log_mass(trials, count, probability))
    return count


def _log_mass(trials: int, count: int, probability: float) -> float:
    ways = math.lgamma(trials + 1) - math.lgamma(count + 1) - math.lgamma(trials - count + 1)
    return ways + count * math.log(probability) + (trials - count) * math.log1p(-probability)
