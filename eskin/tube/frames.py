# ruff: noqa: PD011 - a tube has values
"""Tubes in pandas and xarray, with nothing lost: bounds in columns, all else in attributes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import Interval
from eskin.interval.frames import column_of
from eskin.tube.tube import Tube

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd
    import xarray as xr
    from numpy.typing import NDArray

_AXIS: Final = "time"


def to_pandas(tube: Tube) -> pd.DataFrame:
    """See `eskin.Tube.to_pandas`."""
    frame = tube.values.to_pandas()
    import pandas as pd  # noqa: PLC0415 - it is there

    frame.index = pd.DatetimeIndex(tube.moments.astype("datetime64[ns]"), tz="UTC", name=_AXIS)
    frame.attrs = _attributes(tube)
    return frame


def from_pandas(frame: pd.DataFrame) -> Tube:
    """See `eskin.Tube.from_pandas`."""
    index = frame.index
    if getattr(index, "tz", None) is not None:
        index = index.tz_convert("UTC").tz_localize(None)
    return _tube(Interval.from_pandas(frame), index.to_numpy(), frame.attrs)


def to_xarray(tube: Tube) -> xr.Dataset:
    """See `eskin.Tube.to_xarray`."""
    data = tube.values.to_xarray().rename({"axis_0": _AXIS})
    data = data.assign_coords({_AXIS: tube.moments.astype("datetime64[ns]")})
    return data.assign_attrs(_attributes(tube))


def from_xarray(data: xr.Dataset) -> Tube:
    """See `eskin.Tube.from_xarray`."""
    moments = column_of(data, _AXIS).to_numpy()
    return _tube(Interval.from_xarray(data), moments, data.attrs)


def _attributes(tube: Tube) -> dict[str, Any]:
    """What columns do not say. Of a part, the moments stand in its index."""
    return {
        "unit": tube.unit,
        "coverage": tube.coverage,
        "earliest_ns": int(tube.time[0]),
        "latest_ns": int(tube.time[1]),
        "dt_ns": int(tube.dt),
    }


def _tube(values: Interval, moments: NDArray[Any], given: Mapping[Any, Any]) -> Tube:
    try:
        unit, coverage = given["unit"], float(given["coverage"])
        time = int(given["earliest_ns"]), int(given["latest_ns"])
        dt = int(given["dt_ns"])
    except KeyError as error:
        raise IntervalError(
            f"the attribute {error} is missing; set it in attrs, as to_pandas and to_xarray do"
        ) from None
    if moments.dtype.kind != "M":
        raise IntervalError(f"a tube's samples have times (datetime64), not {moments.dtype}")
    at = moments.astype("datetime64[ns]").astype(np.int64)
    if at.size > 1:
        steps = np.diff(at)
        dt = int(steps[0])
        if dt <= 0 or np.any(steps != dt):
            raise IntervalError(
                "samples are not equally spaced; put rows of NaN where some are missing "
                "(pandas: asfreq; xarray: resample)"
            )
    moved = int(at[0]) - sum(time) // 2 if at.size else 0
    return Tube((time[0] + moved, time[1] + moved), dt, values, unit, coverage)
