"""A tube: equally spaced interval samples of one quantity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.errors import IntervalError, MissingExtraError
from eskin.interval import Interval, require_plain
from eskin.interval.frames import column_of
from eskin.interval.markup import html_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from eskin.tube.plot import PeakTable

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_AXIS: Final = "time"


@dataclass(frozen=True, slots=True)
class Tube:
    """Equally spaced interval samples of one quantity.

    A tube states samples: the quantity lay in the interval at the instant of each. What is read
    into the time between is up to the reader. A chart draws each sample as wide as its period, and
    a monitor (`eskin.monitor`) reads samples that are held until the next one.

    Attributes:
        time: Enclosure ``(earliest, latest)`` of the first sample's instant, UTC ns since 1970.
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
    def instants(self) -> NDArray[np.int64]:
        """The middle of each sample's time enclosure, UTC ns (the place where it is drawn)."""
        return self.first_instant + self.dt * np.arange(len(self), dtype=np.int64)

    @property
    def first_instant(self) -> int:
        """The middle of the first sample's time enclosure, UTC ns, rounded down."""
        return (self.time[0] + self.time[1]) // 2

    @property
    def time_error(self) -> int:
        """How far a sample's true instant may lie from ``instants``, in ns, rounded up."""
        return (self.time[1] - self.time[0] + 1) // 2

    def plot(self, ax: Axes | None = None, *, peaks: PeakTable | None = None) -> Axes:
        """Draw the band, what is missing, and peaks, with matplotlib.

        Each sample is drawn as wide as its period, and nothing between samples that are missing.

        Args:
            ax: Where to draw; by default a figure of its own.
            peaks: What `eskin.find_peaks` found in this tube.

        Returns:
            Where it was drawn.

        Raises:
            MissingExtraError: matplotlib is not installed.
        """
        try:
            from eskin.tube.plot import new_axes, plot_samples  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise MissingExtraError("tube.plot", "matplotlib", "eskin[figures]") from error
        axes = new_axes() if ax is None else ax
        axes.set_xlabel(f"time in s since {instant_text(self.first_instant)}")
        plot_samples(axes, self.values, self.dt / 1e9, self.unit, peaks)
        return axes

    def to_pandas(self) -> pd.DataFrame:
        """Columns ``lo`` and ``hi`` by time, what is missing as NaN; `from_pandas` gives it back.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        frame = self.values.to_pandas()
        import pandas as pd  # noqa: PLC0415 - an optional dependency

        instants = self.instants.astype("datetime64[ns]")
        frame.index = pd.DatetimeIndex(instants, tz="UTC", name=_AXIS)
        frame.attrs = self._attributes()
        return frame

    @classmethod
    def from_pandas(cls, frame: pd.DataFrame) -> Tube:
        """The tube of columns ``lo`` and ``hi``, an index in time, and attributes: see `to_pandas`.

        Rows may be cut off or left out step by step. NaN is a side that is unbounded.

        Raises:
            IntervalError: A column or an attribute is missing, or rows are not equally spaced.
        """
        index = frame.index
        if getattr(index, "tz", None) is not None:
            index = index.tz_convert("UTC").tz_localize(None)
        return cls._from_samples(Interval.from_pandas(frame), index.to_numpy(), frame.attrs)

    def to_xarray(self) -> xr.Dataset:
        """Variables ``lo`` and ``hi`` along ``time``; else as `to_pandas`.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        data = self.values.to_xarray().rename({"axis_0": _AXIS})
        data = data.assign_coords({_AXIS: self.instants.astype("datetime64[ns]")})
        return data.assign_attrs(self._attributes())

    @classmethod
    def from_xarray(cls, data: xr.Dataset) -> Tube:
        """The tube of variables ``lo`` and ``hi`` along ``time``; else as `from_pandas`.

        Raises:
            IntervalError: A variable or an attribute is missing, or samples are not equally spaced.
        """
        instants = column_of(data, _AXIS).to_numpy()
        return cls._from_samples(Interval.from_xarray(data), instants, data.attrs)

    def _attributes(self) -> dict[str, Any]:
        """What columns do not hold; the instants of part of a table stand in its index."""
        return {
            "unit": self.unit,
            "coverage": self.coverage,
            "earliest_ns": int(self.time[0]),
            "latest_ns": int(self.time[1]),
            "dt_ns": int(self.dt),
        }

    @classmethod
    def _from_samples(
        cls, values: Interval, instants: NDArray[Any], attributes: Mapping[Any, Any]
    ) -> Tube:
        try:
            unit, coverage = attributes["unit"], float(attributes["coverage"])
            time = int(attributes["earliest_ns"]), int(attributes["latest_ns"])
            dt = int(attributes["dt_ns"])
        except KeyError as error:
            raise IntervalError(
                f"the attribute {error} is missing; set it in attrs, as to_pandas and to_xarray do"
            ) from None
        if instants.dtype.kind != "M":
            raise IntervalError(f"a tube's samples have times (datetime64), not {instants.dtype}")
        at = instants.astype("datetime64[ns]").astype(np.int64)
        if at.size > 1:
            steps = np.diff(at)
            dt = int(steps[0])
            if dt <= 0 or np.any(steps != dt):
                raise IntervalError(
                    "samples are not equally spaced; put rows of NaN where some are missing "
                    "(pandas: asfreq; xarray: resample)"
                )
        moved = int(at[0]) - sum(time) // 2 if at.size else 0
        return cls((time[0] + moved, time[1] + moved), dt, values, unit, coverage)

    def _repr_html_(self) -> str:
        step = self.dt / 1e9
        caption = (
            f"{len(self)} samples of {step:g} s in {self.unit}, coverage {self.coverage:.9g}, "
            f"from {instant_text(self.first_instant)} ± {self.time_error} ns"
        )

        def row(k: int) -> list[str]:
            return [str(k), f"{k * step:.9g}", str(self.values[k])]

        return html_table(caption, ["", "s", self.unit], len(self), row)


def instant_text(instant: int) -> str:
    """An instant in ns as ISO 8601 in UTC, to the microsecond."""
    try:
        found = _EPOCH + timedelta(microseconds=instant // 1000)
    except OverflowError:
        return f"{instant} ns"
    return found.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
