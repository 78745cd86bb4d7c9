"""Draws figures with matplotlib, which is an extra: ``pip install 'eskin[figures]'``."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Final

from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import ScalarFormatter

from eskin.design import draw_paving
from eskin.figures.figure import Look
from eskin.plot_style import COLOURS, axis_formatter

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from eskin.design import Paving
    from eskin.figures.figure import Figure, Panel

STYLES: Final = ("-", "--", ":", "-.")
_DPI: Final = 150
_WIDTH: Final = 9.0
_PANEL_HEIGHT: Final = 2.3
_MARGIN: Final = 1.5
_INSET: Final = (0.14, 0.48, 0.5, 0.47)
"""Left, bottom, width and height of an inset as shares of its panel."""


def write_picture(path: Path, figure: Figure) -> None:
    """Write a figure as PNG.

    Raises:
        OSError: The file cannot be written.
    """
    draw_picture(figure).savefig(path, dpi=_DPI, metadata={"Software": None})


def write_paving(
    path: Path, paving: Paving, *, title: str, x: tuple[str, str, str], y: tuple[str, str, str]
) -> None:
    """Write a paving of two parameters as PNG.

    Args:
        path: The file.
        paving: What to draw.
        title: What it shows.
        x: The parameter to the right: its name, its label, its SI unit.
        y: Likewise upwards.

    Raises:
        OSError: The file cannot be written.
    """
    canvas = Canvas(figsize=(_WIDTH, 2 * _PANEL_HEIGHT), layout="constrained")
    axes = canvas.subplots()
    draw_paving(paving, axes, x=x[0], y=y[0])
    axes.set_xlabel(x[1])
    axes.set_ylabel(y[1])
    for axis, unit in ((axes.xaxis, x[2]), (axes.yaxis, y[2])):
        axis.set_major_formatter(axis_formatter(unit) if unit else ScalarFormatter())
    canvas.suptitle(title, fontweight="bold", fontsize=10)
    canvas.savefig(path, dpi=_DPI, metadata={"Software": None})


def draw_picture(figure: Figure) -> Canvas:
    """Draw a figure, its panels from top to bottom."""
    count = len(figure.panels)
    height = _PANEL_HEIGHT * count + (_MARGIN if count > 1 else _MARGIN + 1.5)
    canvas = Canvas(figsize=(_WIDTH, height), layout="constrained")
    axes = canvas.subplots(count, 1, squeeze=False)
    for number, panel in enumerate(figure.panels):
        _draw(axes[number, 0], figure, panel)
    axes[-1, 0].set_xlabel(figure.xlabel)
    canvas.suptitle(figure.title, fontweight="bold")
    caption = textwrap.fill(
        figure.caption.replace(" = ", "\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}"), 125
    )
    canvas.supxlabel(caption, fontsize=8, color="#444444", x=0.02, ha="left")
    return canvas


def _draw(axes: Axes, figure: Figure, panel: Panel) -> None:
    if panel.logarithmic is not None:
        axes.set_yscale("log")
        axes.set_ylim(*panel.logarithmic)
    _draw_columns(axes, figure, panel, panel.window)
    axes.yaxis.set_major_formatter(axis_formatter(panel.unit))
    axes.set_ylabel(panel.ylabel)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    if panel.inset is not None:
        inset = axes.inset_axes(_INSET)
        _draw_columns(inset, figure, panel, panel.inset)
        inset.yaxis.set_major_formatter(axis_formatter(panel.unit))
        inset.tick_params(labelsize=8)


def _draw_columns(
    axes: Axes, figure: Figure, panel: Panel, window: tuple[float, float] | None
) -> None:
    x = next(iter(figure.columns.values()))
    for k, (label, (lo, hi)) in enumerate(panel.bands.items()):
        colour = COLOURS[k % len(COLOURS)]
        axes.fill_between(
            x,
            figure.columns[lo],
            figure.columns[hi],
            color=colour,
            alpha=0.25,
            linewidth=0,
            label=label,
        )
    for k, (label, column) in enumerate(panel.lines.items()):
        look = panel.looks.get(label, Look())
        axes.plot(
            x,
            figure.columns[column],
            linestyle=look.style or STYLES[k % len(STYLES)],
            color=COLOURS[(k if look.colour is None else look.colour) % len(COLOURS)],
            linewidth=look.width,
            alpha=look.alpha,
            label=label,
        )
    axes.margins(x=0)
    if window is not None:
        axes.set_xlim(*window)
    axes.xaxis.set_major_formatter(axis_formatter(figure.x_unit))
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
