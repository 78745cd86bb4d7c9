"""Evaluate a formula while samples arrive, in bounded memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import MonitorError
from eskin.monitor.checks import channel_horizons, check
from eskin.monitor.evaluation import Evaluation
from eskin.monitor.runs import END
from eskin.monitor.signal import Signal, held_samples
from eskin.monitor.verdicts import Piece, Verdicts

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.monitor.formula import Formula


class Monitor:
    """A formula over channels whose samples arrive one by one.

    Push samples, and now and then `take` what is decided for good: that costs little more for a
    thousand new samples than for one. `verdicts` is the view at this moment, also of what is still
    open. Samples that no open verdict needs are dropped.

    Args:
        formula: All its windows must be bounded.
        units: UCUM code of each channel.
        coverage: Of channels whose intervals do not always enclose the truth.
        capacity: How many samples a channel may keep.

    Attributes:
        formula: What is evaluated.

    Raises:
        MonitorError: The formula does not fit the channels, or a window is unbounded.
    """

    def __init__(
        self,
        formula: Formula,
        units: Mapping[str, str],
        *,
        coverage: Mapping[str, float] | None = None,
        capacity: int = 2**16,
    ) -> None:
        check(formula, units, bounded=True)
        self.formula = formula
        self._channels = {
            name: _Channel(name, units[name], (coverage or {}).get(name, 1.0), capacity)
            for name in sorted(formula.channels)
        }
        self._past = {name: each.past or 0 for name, each in channel_horizons(formula).items()}
        self._settled = -END  # the first tick whose verdict was not taken
        self._view: Verdicts | None = None

    def push(
        self, channel: str, earliest: int, latest: int, lo: float, hi: float, *, period: int
    ) -> None:
        """Add the next sample of a channel, with its moment's enclosure in ns.

        A sample that is unbounded on both sides is a missing one: the sample before it is held for
        one period.

        Raises:
            MonitorError: The formula has no such channel, the sample is before the last one, or the
                channel keeps too many, as another channel is silent.
        """
        each = self._channel(channel)
        if lo == -np.inf and hi == np.inf:
            each.gap()
        else:
            each.push(earliest, latest, lo, hi, period)
        self._view = None

    def gap(self, channel: str, until: int | None = None) -> None:
        """State that samples are missing after the last one of a channel.

        Args:
            channel: Which one.
            until: No sample is there before this instant in ns; ``None`` where that is not known.

        Raises:
            MonitorError: The sample was said to be held for longer.
        """
        each = self._channel(channel)
        if each.until is not None and each.gaps and not each.gaps[-1]:
            raise MonitorError(
                f"the last sample of {channel} is held until {each.until} ns; push one first",
                value=each.until,
            )
        each.gap()
        self._wait(each, until)

    def hold(self, channel: str, until: int) -> None:
        """State that the last sample of a channel is held: no other, and no gap, before an instant.

        Args:
            channel: Which one.
            until: The instant in ns.
        """
        self._wait(self._channel(channel), until)

    def _wait(self, channel: _Channel, until: int | None) -> None:
        if until is not None:
            channel.until = until if channel.until is None else max(channel.until, until)
        self._view = None

    @property
    def verdicts(self) -> Verdicts:
        """The verdicts by what has arrived; of times that were taken, no more."""
        if self._view is None:
            signals = {name: each.signal() for name, each in self._channels.items()}
            self._view = Verdicts(Evaluation(self.formula, signals))
        return self._view

    def take(self) -> list[Piece]:
        """The pieces that became final since the last call, without a hole between them.

        Two pieces of one verdict may follow each other.
        """
        if self._settled > END:
            return []
        view = self.verdicts
        last = view.final_until(self._settled)
        if last is None:
            return []
        found = [*view.pieces(self._settled, last)]
        self._settled = last + 1
        for name, each in self._channels.items():
            each.drop_before(self._settled - 2 * self._past[name] - 1)
        self._view = None
        return found

    def __len__(self) -> int:
        """How many samples are kept."""
        return sum(len(each.samples) for each in self._channels.values())

    def _channel(self, name: str) -> _Channel:
        try:
            return self._channels[name]
        except KeyError:
            raise MonitorError(
                f"the formula has no channel {name}; push only {', '.join(self._channels)}",
                value=name,
            ) from None


class _Channel:
    """Samples of one channel that are still needed."""

    def __init__(self, name: str, unit: str, coverage: float, capacity: int) -> None:
        self.name = name
        self.samples: list[tuple[int, int, float, float, int]] = []
        self.gaps: list[bool] = []
        self.until: int | None = None
        self._unit, self._coverage, self._capacity = unit, coverage, capacity

    def push(self, earliest: int, latest: int, lo: float, hi: float, period: int) -> None:
        if len(self.samples) >= self._capacity:
            raise MonitorError(
                f"{self.name} keeps {self._capacity} samples; take what is decided, or state the "
                "gap of a channel that is silent",
                value=len(self.samples),
            )
        # Moments ascend strictly.
        after = self.samples[-1][0] if self.samples else -END
        earliest = max(earliest, after)
        if self.until is not None:
            earliest = max(earliest, self.until)
        if not (earliest <= latest and after < latest and lo <= hi):
            raise MonitorError(
                f"a sample of {self.name} in [{earliest}, {latest}] ns with [{lo}, {hi}] is "
                "reversed, or not after the last one, or has NaN; correct it",
                value=(earliest, latest, lo, hi),
            )
        self.samples.append((earliest, latest, lo, hi, period))
        self.gaps.append(False)
        self.until = None

    def gap(self) -> None:
        if self.gaps:
            self.gaps[-1] = True

    def signal(self) -> Signal:
        times = np.array([each[:2] for each in self.samples], np.int64).reshape(-1, 2)
        values = np.array([each[2:4] for each in self.samples], np.float64).reshape(-1, 2)
        return Signal(
            times[:, 0],
            times[:, 1],
            values[:, 0],
            values[:, 1],
            np.array([each[4] for each in self.samples], np.int64),
            np.array(self.gaps, bool),
            unit=self._unit,
            coverage=self._coverage,
            until=self.until,
        )

    def drop_before(self, tick: int) -> None:
        """Drop samples that hold at no tick from a given one on; the last one stays."""
        if len(self.samples) < 2:
            return
        held = held_samples(self.signal())
        needed = held.index[held.last >= tick]
        first = int(needed[0]) if needed.size else len(self.samples) - 1
        del self.samples[:first], self.gaps[:first]
