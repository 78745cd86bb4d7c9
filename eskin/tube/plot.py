"""A tube as a picture: its band, what is missing, and its peaks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Protocol

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection

from eskin.interval import Verdict
from eskin.plot_style import COLOURS, axis_formatter

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from eskin.interval import Floats, Interval

_MARGIN: Final = 0.08
"""Share of the height above and below; there, sides that are unbounded end."""
_WITHOUT_PREFIX: Final = {"1": "", "%": "%", "Cel": "°C", "rad": "rad"}
_LOOKS: Final = {
    Verdict.CERTAIN: ("certain peak", "-", COLOURS[1]),
    Verdict.POSSIBLE: ("possible peaks", "--", COLOURS[3]),
}


def new_axes() -> Axes:
    """Axes of a figure of their own, which a notebook shows."""
    return plt.subplots(figsize=(9.0, 3.2), layout="constrained")[1]


class PeakTable(Protocol):
    """Peaks in a table, as `eskin.Peaks` has them."""

    table: NDArray[np.void]


def plot_samples(
    axes: Axes, values: Interval, step: float, unit: str, peaks: PeakTable | None
) -> None:
    """Draw equally spaced samples.

    Args:
        axes: Where to draw.
        values: The samples, along one axis.
        step: Sampling period in s.
        unit: UCUM code.
        peaks: What was found in them.
    """
    times: Floats = step * np.arange(len(values), dtype=np.float64)
    missing = np.asarray(values.is_entire | values.is_empty)
    least, greatest = _limits(values.inf[~missing], values.sup[~missing])
    lo, hi = (np.clip(side, least, greatest) for side in (values.inf, values.sup))
    edges = np.repeat(times, 2) + np.tile([-0.5 * step, 0.5 * step], len(values))
    axes.fill_between(
        edges, np.repeat(lo, 2), np.repeat(hi, 2), where=np.repeat(~missing, 2).tolist(),
        color=COLOURS[0], alpha=0.45, linewidth=0.6, label="enclosure",
    )  # fmt: skip
    for number, (first, last) in enumerate(_runs(missing)):
        axes.axvspan(
            float(times[first] - 0.5 * step), float(times[last] + 0.5 * step),
            facecolor="none", edgecolor="#888888", hatch="///", linewidth=0.0, alpha=0.6,
            label="missing" if number == 0 else None,
        )  # fmt: skip
    if peaks is not None:
        _draw_peaks(axes, peaks, times, (least, greatest))
    axes.set_ylim(least, greatest)
    axes.margins(x=0)
    _name_values(axes, unit)
    if axes.get_legend_handles_labels()[1] != ["enclosure"]:
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def _limits(lo: Floats, hi: Floats) -> tuple[float, float]:
    """Of the axis upwards, a margin around all bounds that are finite."""
    ends = np.concatenate([lo[np.isfinite(lo)], hi[np.isfinite(hi)]])
    if ends.size == 0:
        return 0.0, 1.0
    least, greatest = float(ends.min()), float(ends.max())
    margin = _MARGIN * (greatest - least) or max(abs(least), 1e-300) * _MARGIN
    return least - margin, greatest + margin


def _runs(where: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each run."""
    turns = np.flatnonzero(np.diff(np.concatenate([[False], where, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in turns.reshape(-1, 2)]


def _draw_peaks(axes: Axes, peaks: PeakTable, times: Floats, limits: tuple[float, float]) -> None:
    """From the sample before each peak to that after it, as high as its height is known."""
    for verdict, (label, style, colour) in _LOOKS.items():
        table = peaks.table[peaks.table["verdict"] == verdict]
        if len(table) == 0:
            continue
        left, right = times[table["first"]], times[table["last"]]
        low, high = (np.clip(table[f"height_{end}"], *limits) for end in ("inf", "sup"))
        corners = np.stack([left, low, right, low, right, high, left, high], axis=1)
        axes.add_collection(
            PolyCollection(
                list(corners.reshape(-1, 4, 2)),
                facecolors="none",
                edgecolors=colour,
                linestyles=style,
                linewidths=1.2,
                label=label,
            )
        )


def _name_values(axes: Axes, unit: str) -> None:
    shown = _WITHOUT_PREFIX.get(unit, unit)
    axes.set_ylabel(f"in {shown}" if shown else "")
    if unit not in _WITHOUT_PREFIX:
        axes.yaxis.set_major_formatter(axis_formatter(unit))
