"""Errors that samples of a channel have in common: x = α·(u + β).

α and β are unknown, and constant within an epoch; u has errors of each sample alone. A sample's
interval holds all values that [α], [β] and its [u] allow. So [u] follows from the interval: it is
the widest one for which that is so.

In a sum of samples of one epoch, Σ cᵢ·xᵢ = α·(Σ cᵢ·uᵢ + β·Σ cᵢ): of a difference β cancels, and α
counts once. See docs/monitors.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import MonitorError
from eskin.interval import Interval
from eskin.monitor.checks import Columns, enclosed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

    from eskin.monitor.checks import Linear
    from eskin.monitor.formula import Variable


@dataclass(frozen=True, eq=False)
class SharedError:
    """What the samples of a channel share.

    Args:
        alpha: Bounds of the factor α; above 0.
        beta: Bounds of β, in the unit of u.
        epoch: Of each sample; 0 where it shares nothing.
        name: Channels with one name share the same α and β; by default a channel has its own.

    Raises:
        MonitorError: Bounds are reversed or not finite, α may be 0, or epochs are no whole numbers
            from 0 on.
    """

    alpha: tuple[float, float]
    beta: tuple[float, float]
    epoch: NDArray[np.int64]
    name: str

    def __init__(
        self,
        alpha: tuple[float, float],
        beta: tuple[float, float] = (0.0, 0.0),
        epoch: ArrayLike = 1,
        name: str = "",
    ) -> None:
        for what, (lo, hi) in (("alpha", alpha), ("beta", beta)):
            if not (np.isfinite(lo) and np.isfinite(hi) and lo <= hi):
                raise MonitorError(f"{what} must be finite bounds lo <= hi, not [{lo}, {hi}]")
        if alpha[0] <= 0.0:
            raise MonitorError(f"alpha must be above 0, not [{alpha[0]}, {alpha[1]}]", value=alpha)
        epochs = np.asarray(epoch)
        if epochs.dtype.kind not in "iu" or np.any(epochs < 0):
            raise MonitorError(f"epochs are whole numbers from 0 on, not {epochs}", value=epoch)
        set_ = object.__setattr__
        set_(self, "alpha", alpha)
        set_(self, "beta", beta)
        set_(self, "epoch", epochs.astype(np.int64))
        set_(self, "name", name)

    def own_parts(self, bounds: Interval) -> tuple[Interval, NDArray[np.bool_]]:
        """[u] of samples, and which have one.

        A sample has none where a side is unbounded, or where it is narrower than any [u] allows.
        """
        least, most = self.alpha
        below, above = self.beta
        known = np.isfinite(bounds.inf) & np.isfinite(bounds.sup)
        lo, hi = np.where(known, bounds.inf, 0.0), np.where(known, bounds.sup, 0.0)
        low = (Interval(lo) / Interval(np.where(lo >= 0.0, least, most)) - below).inf
        high = (Interval(hi) / Interval(np.where(hi >= 0.0, most, least)) - above).sup
        known &= low <= high
        return Interval(np.where(known, low, 0.0), np.where(known, high, 0.0)), known


class SharingColumns(Columns):
    """Intervals of channels at some instants, some of which share errors.

    Args:
        columns: The intervals.
        shares: Of channels that share errors: their errors, and the epoch at each instant.
    """

    def __init__(
        self,
        columns: Mapping[Variable, Interval],
        shares: Mapping[Variable, tuple[SharedError, NDArray[np.int64]]],
    ) -> None:
        super().__init__(columns)
        self._shares = shares
        self._groups: dict[str, list[Variable]] = {}
        for variable, (error, _) in shares.items():
            self._groups.setdefault(error.name or variable[0], []).append(variable)

    def narrow(self, linear: Linear, value: Interval) -> Interval:
        """A sum again, with what its channels share counted once."""
        groups = [
            (own, [each for each in members if each in linear.terms])
            for own, members in self._groups.items()
        ]
        groups = [(own, members) for own, members in groups if len(members) > 1]
        if not groups:
            return value
        total: Interval = Interval(0.0) + enclosed(linear.constant)
        left = dict(linear.terms)
        for _, members in groups:
            total = total + self._joined({each: left.pop(each) for each in members})
        for variable, number in left.items():
            total = total + self[variable] * enclosed(number)
        narrower = total.intersection(value)
        return Interval.where(narrower.is_empty, value, narrower)

    def _joined(self, terms: Mapping[Variable, Fraction]) -> Interval:
        """A sum of samples with the same α and β, where they are of one epoch."""
        errors = [self._shares[variable] for variable in terms]
        shared, first = errors[0]
        plain: Interval = Interval(0.0)
        parts: Interval = enclosed(sum(terms.values(), Fraction(0))) * Interval(*shared.beta)
        together = first > 0
        for variable, number in terms.items():
            error, epoch = self._shares[variable]
            column = self[variable]
            plain = plain + column * enclosed(number)
            own, known = error.own_parts(column)
            together = together & (epoch == first) & known
            parts = parts + own * enclosed(number)
        return Interval.where(together, parts * Interval(*shared.alpha), plain)
