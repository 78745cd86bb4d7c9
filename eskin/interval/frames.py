"""Intervals in pandas and xarray, with nothing lost: columns or variables ``lo`` and ``hi``.

A missing interval is NaN on both sides there, and unbounded on both sides here; one NaN is one side
that is unbounded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eskin.errors import IntervalError, MissingExtraError
from eskin.interval.conversion import enclose

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eskin.interval.bounds import Bounds
    from eskin.interval.conversion import Floats


def to_pandas(x: Bounds) -> pd.DataFrame:
    """A row for each interval of one axis.

    Raises:
        IntervalError: It has not one axis.
        MissingExtraError: pandas is not installed.
    """
    try:
        import pandas as pd  # noqa: PLC0415 - a library of few
    except ImportError as error:
        raise MissingExtraError("to_pandas", "pandas", "pandas") from error
    if x.ndim != 1:
        raise IntervalError(f"a table has one axis of rows, not shape {x.shape}; see to_xarray")
    return pd.DataFrame(_columns(x))


def sides_of_frame(frame: pd.DataFrame) -> tuple[Floats, Floats]:
    """Read the bounds in columns ``lo`` and ``hi``.

    Raises:
        IntervalError: A column is missing, or holds no real numbers.
    """
    return _side(column_of(frame, "lo"), "lo"), _side(column_of(frame, "hi"), "hi")


def to_xarray(x: Bounds) -> xr.Dataset:
    """Variables ``lo`` and ``hi`` of the same axes.

    Raises:
        MissingExtraError: xarray is not installed.
    """
    try:
        import xarray as xr  # noqa: PLC0415 - a library of few
    except ImportError as error:
        raise MissingExtraError("to_xarray", "xarray", "xarray") from error
    axes = [f"axis_{k}" for k in range(x.ndim)]
    return xr.Dataset({name: (axes, side) for name, side in _columns(x).items()})


def sides_of_dataset(data: xr.Dataset) -> tuple[Floats, Floats]:
    """Read variables ``lo`` and ``hi``, broadcast by the names of their axes.

    Raises:
        IntervalError: A variable is missing, or holds no real numbers.
    """
    import xarray as xr  # noqa: PLC0415 - a library of few

    lo, hi = xr.broadcast(column_of(data, "lo"), column_of(data, "hi"))
    return _side(lo, "lo"), _side(hi, "hi")


def _columns(x: Bounds) -> dict[str, Floats]:
    entire = (x.inf == -np.inf) & (x.sup == np.inf)
    return {"lo": np.where(entire, np.nan, x.inf), "hi": np.where(entire, np.nan, x.sup)}


def column_of(table: Any, name: str) -> Any:
    """A column, or a variable.

    Raises:
        IntervalError: It is missing.
    """
    try:
        return table[name]
    except KeyError:
        raise IntervalError(
            f"{name} is missing; bounds are in 'lo' and 'hi', and a Dataset's tube has 'time'"
        ) from None


def _side(column: Any, name: str) -> Floats:
    """Bounds on one side, rounded outward; unbounded where they are missing."""
    missing = np.asarray(column.isnull())  # noqa: PD003 - xarray has no isna
    lo, hi = enclose(column.fillna(0).to_numpy(), name)
    return np.where(missing, -np.inf, lo) if name == "lo" else np.where(missing, np.inf, hi)
