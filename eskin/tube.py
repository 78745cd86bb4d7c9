"""Tubes: interval-valued signals over time (the term of interval analysis; see codac)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import Interval, require_plain

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Tube:
    """Equally spaced interval samples of one quantity.

    A sample holds at its instant; nothing is claimed between instants.

    Attributes:
        time: Enclosure ``(earliest, latest)`` of the first sample's moment, UTC ns since 1970.
            Sample k was taken in ``[earliest + k·dt, latest + k·dt]``.
        dt: Sampling period in ns.
        values: n intervals, shape ``(n,)``, in ``unit``.
        unit: UCUM code, such as ``F``.
        coverage: Probability with which each sample's interval encloses the truth; 1.0 where the
            noise is bounded.

    Raises:
        IntervalError: The parts do not fit each other.
    """

    time: tuple[int, int]
    dt: int
    values: Interval
    unit: str
    coverage: float

    def __post_init__(self) -> None:
        if not isinstance(self.values, Interval):
            raise IntervalError(f"values must be an Interval, not {type(self.values).__name__}")
        if len(self.values.shape) != 1:
            raise IntervalError(f"a tube has one axis, not shape {self.values.shape}")
        if not all(isinstance(each, (int, np.integer)) for each in (*self.time, self.dt)):
            raise IntervalError(f"time and dt must be whole ns, not {self.time} and {self.dt}")
        if self.time[0] > self.time[1]:
            raise IntervalError(f"time enclosure is reversed: {self.time}")
        if self.dt <= 0:
            raise IntervalError(f"dt must be positive, in ns, not {self.dt}")
        require_plain(self.coverage, "coverage")
        if not 0.0 <= self.coverage <= 1.0:
            raise IntervalError(f"coverage must lie in [0, 1], not {self.coverage}")

    def __len__(self) -> int:
        return self.values.shape[0]

    def __getitem__(self, part: slice) -> Tube:
        """The tube of some of the samples: ``tube[10:20]``, ``tube[::2]``; single ones in `values`.

        Raises:
            IntervalError: It is no slice, or one that runs backwards.
        """
        if not isinstance(part, slice):
            raise IntervalError(f"a tube is cut by slices, not {part!r}; see values for one sample")
        start, _, step = part.indices(len(self))
        if step < 0:
            raise IntervalError(f"a tube runs forwards; its step must be positive, not {step}")
        earliest, latest = self.time
        moved = earliest + start * self.dt, latest + start * self.dt
        return replace(self, time=moved, dt=self.dt * step, values=self.values[part])

    @property
    def moments(self) -> NDArray[np.int64]:
        """The middle of each sample's time enclosure, UTC ns (the place where it is drawn)."""
        return self.first_moment + self.dt * np.arange(len(self), dtype=np.int64)

    @property
    def first_moment(self) -> int:
        """The middle of the first sample's time enclosure, UTC ns, rounded down."""
        return (self.time[0] + self.time[1]) // 2

    @property
    def time_error(self) -> int:
        """How far a sample's true moment may lie from ``moments``, in ns, rounded up."""
        return (self.time[1] - self.time[0] + 1) // 2
