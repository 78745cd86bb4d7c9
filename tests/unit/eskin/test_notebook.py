# ruff: noqa: PD011 - a tube has values
"""What a notebook shows: tables, pictures, and frames of pandas and xarray."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import eskin
from eskin import Interval, Tube
from eskin.errors import IntervalError, MissingExtraError

mpl.use("agg")
START = 1_790_000_000_000_000_000
INF = np.inf


def tube(lo: list[float], hi: list[float], unit: str = "F") -> Tube:
    return Tube((START - 3, START + 4), 5_000_000, Interval(lo, hi), unit, 0.999)


SOME = tube([1.0, -INF, 3.0, 2.0, -INF], [2.0, INF, INF, 2.5, 0.5])
BOUND = st.floats(allow_nan=False, allow_infinity=False)


@st.composite
def intervals(draw: st.DrawFn) -> tuple[float, float]:
    lo, hi = sorted((draw(BOUND), draw(BOUND)))
    kind = draw(st.sampled_from("blrn"))
    return -INF if kind in "ln" else lo, INF if kind in "rn" else hi


@st.composite
def tubes(draw: st.DrawFn) -> Tube:
    pairs = draw(st.lists(intervals(), max_size=6))
    first = draw(st.integers(0, 2**62))
    time = first, first + draw(st.integers(0, 10**9))
    values = Interval([lo for lo, _ in pairs], [hi for _, hi in pairs])
    dt = draw(st.integers(1, 10**9))
    return Tube(time, dt, values, draw(st.sampled_from(["F", "m2", "%"])), draw(st.floats(0, 1)))


def assert_same(one: Tube, other: Tube) -> None:
    assert (one.time, one.dt, one.unit, one.coverage) == (
        other.time, other.dt, other.unit, other.coverage,
    )  # fmt: skip
    assert one.values.shape == other.values.shape
    assert np.all(one.values.equal(other.values))


def corners(path: Any) -> Any:
    """Of a drawn polygon."""
    return np.asarray(path.vertices)


def cells(html: str) -> list[list[str]]:
    rows = ET.fromstring(html).findall(".//tbody/tr")  # noqa: S314 - our own text
    return [["".join(cell.itertext()) for cell in row] for row in rows]


@given(tubes())
def test_tube_comes_back_from_pandas_and_xarray(given: Tube) -> None:
    assert_same(Tube.from_pandas(given.to_pandas()), given)
    assert_same(Tube.from_xarray(given.to_xarray()), given)


@given(st.lists(intervals(), min_size=1, max_size=6))
def test_intervals_come_back_from_pandas_and_xarray(pairs: list[tuple[float, float]]) -> None:
    x = Interval([lo for lo, _ in pairs], [hi for _, hi in pairs])
    assert np.all(Interval.from_pandas(x.to_pandas()).equal(x))
    square = Interval.stack([x, Interval.empty(x.shape)])
    assert np.all(Interval.from_xarray(square.to_xarray()).equal(square))
    single = x[0]
    assert np.all(Interval.from_xarray(single.to_xarray()).equal(single))


@pytest.mark.parametrize("part", [slice(1, 4), slice(None, None, 2), slice(3, None), slice(9, 9)])
def test_part_of_a_frame_is_the_part_of_the_tube(part: slice) -> None:
    cut = SOME[part]
    for found in (
        Tube.from_pandas(SOME.to_pandas().iloc[part]),
        Tube.from_xarray(SOME.to_xarray().isel(time=part)),
    ):
        assert np.all(found.values.equal(cut.values))
        if len(cut):
            assert found.time == cut.time
        if len(cut) > 1:
            assert found.dt == cut.dt


def test_missing_samples_are_nan_there_and_unbounded_here() -> None:
    frame = SOME.to_pandas()
    assert frame.isna().all(axis=1).tolist() == [False, True, False, False, False]
    frame.iloc[3, 0] = np.nan
    again = Interval.from_pandas(frame)
    assert (again.inf[3], again.sup[3]) == (-INF, 2.5)
    nullable = pd.DataFrame({"lo": [1, None], "hi": [2**53 + 1, None]}, dtype="Int64")
    wide = Interval.from_pandas(nullable)
    assert (wide.inf.tolist(), wide.sup.tolist()) == ([1.0, -INF], [2.0**53 + 2, INF])


def test_frames_that_are_no_tube_are_refused() -> None:
    frame = SOME.to_pandas()
    for wrong in (
        frame.iloc[[0, 1, 3]],
        frame.iloc[::-1],
        frame.reset_index(drop=True),
        frame.rename(columns={"lo": "low"}),
        pd.DataFrame(frame.to_dict("list"), index=frame.index),  # no attributes
        frame.assign(lo=9.0),
    ):
        with pytest.raises(IntervalError):
            Tube.from_pandas(wrong)
    with pytest.raises(IntervalError):
        Tube.from_xarray(SOME.to_xarray().drop_vars("time"))
    with pytest.raises(IntervalError, match="one axis"):
        Interval(1.0).to_pandas()


def test_xarray_broadcasts_by_the_names_of_axes() -> None:
    low = xr.DataArray([1.0, 2.0], dims="taxel")
    data = xr.Dataset({"lo": low, "hi": xr.DataArray([3.0, 4.0, np.nan], dims="time")})
    found = Interval.from_xarray(data)
    assert found.shape == (2, 3)
    assert (found.inf[1, 0], found.sup[1, 2]) == (2.0, INF)


def test_html_tables_are_short_and_escaped() -> None:
    long = Interval(np.arange(1000.0), np.arange(1000.0) + 0.125)
    rows = cells(long._repr_html_())
    assert rows[0] == ["0", "[0, 0.125]", "0.125"]
    assert rows[-1][1] == "[999, 999.125]"
    assert len(rows) == 11
    shown = tube([1.0], [2.0], unit="<script>&")._repr_html_()
    assert "<script>" not in shown
    assert cells(shown) == [["0", "0", "[1, 2]"]]
    assert "[1, 2]" in Interval(1.0, 2.0)._repr_html_()
    assert cells(Interval([])._repr_html_()) == []


def test_html_of_peaks_and_answers_has_their_words() -> None:
    signal = Interval([0.0, 4.0, 0.0, 1.0, 0.0], [0.5, 5.0, 0.5, 4.0, 0.5])
    peaks = eskin.find_peaks(signal, prominence=2.0)
    assert [row[0] for row in cells(peaks._repr_html_())] == ["certain", "possible"]
    answer = Interval([[1.0, 2.0], [3.0, 4.0]], [[2.0, 3.0], [4.0, 5.0]]) > 2.5
    assert cells(answer._repr_html_()) == [
        ["0, 0", "impossible"], ["0, 1", "possible"], ["1, 0", "certain"], ["1, 1", "certain"],
    ]  # fmt: skip
    assert "certain" in answer[1, 1]._repr_html_()


def test_plot_draws_the_band_of_what_is_known_only() -> None:
    given = tube([1.0, -INF, 3.0, 2.0], [2.0, INF, 4.0, 2.5])
    axes = given.plot()
    band = axes.collections[0]
    areas = [corners(path) for path in band.get_paths()]
    spans = [(area[:, 0].min(), area[:, 0].max()) for area in areas]
    assert np.allclose(spans, [(-0.0025, 0.0025), (0.0075, 0.0175)])
    heights = np.concatenate([area[:, 1] for area in areas])
    assert (heights.min(), heights.max()) == (1.0, 4.0)
    (gap,) = axes.patches
    assert np.allclose(gap.get_extents().transformed(axes.transData.inverted()).intervalx,
                       (0.0025, 0.0075))  # fmt: skip
    assert "F" in axes.get_ylabel()
    assert "s" in axes.get_xlabel()
    assert axes.yaxis.get_major_formatter()(2e-12, 0) == "2 pF"
    plt.close("all")


def test_plot_takes_axes_and_peaks_and_draws_unbounded_sides_to_the_edge() -> None:
    given = tube([0.0, 4.0, 0.0, -INF, 0.0], [0.5, 5.0, INF, 0.5, 0.5], unit="1")
    _, axes = plt.subplots()
    peaks = eskin.find_peaks(given, prominence=2.0)
    assert given.plot(axes, peaks=peaks) is axes
    assert given.plot(ax=axes) is axes
    vertices = corners(axes.collections[0].get_paths()[0])
    assert (vertices[:, 1].min(), vertices[:, 1].max()) == axes.get_ylim()
    assert len(axes.collections) == 2 + len({peak.verdict for peak in peaks})
    nothing = tube([-INF], [INF]).plot()
    assert np.all(np.isfinite(nothing.get_ylim()))
    plt.close("all")


@pytest.mark.parametrize(
    ("library", "method"),
    [("matplotlib.pyplot", "plot"), ("pandas", "to_pandas"), ("xarray", "to_xarray")],
)
def test_missing_library_is_an_error_with_the_remedy(
    library: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.delitem(sys.modules, "eskin.tube.plot", raising=False)
    with pytest.raises(MissingExtraError, match="pip install"):
        getattr(SOME, method)()


@pytest.mark.parametrize("absent", [(), ("pandas", "xarray")])
def test_first_minutes_run(tmp_path: Path, absent: tuple[str, ...]) -> None:
    example = Path(__file__).parents[3] / "docs" / "examples" / "first_minutes.py"
    run = (
        f"import runpy, sys; sys.modules.update(dict.fromkeys({absent}));"
        f" runpy.run_path({str(example)!r})"
    )
    done = subprocess.run(
        [sys.executable, "-c", run], cwd=tmp_path, env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True, text=True, timeout=250, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    certain, possible, impossible = map(
        int, re.findall(r"(\d+) (?:certain|possible|impossible)", done.stdout)
    )
    assert certain + possible + impossible == 200
    assert possible > 0
    assert ("the same tube: True" in done.stdout) == (absent == ())
    assert (tmp_path / "first_minutes.png").stat().st_size > 10_000
