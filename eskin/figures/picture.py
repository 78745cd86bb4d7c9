"""Draws figures with matplotlib, which is an extra: ``pip install 'eskin[figures]'``."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Final

from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, FuncFormatter

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.ticker import Formatter

    from eskin.figures.figure import Figure, Panel

COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Okabe and Ito's colours, told apart by the colour-blind, too."""
STYLES: Final = ("-", "--", ":", "-.")
_DPI: Final = 150
_WIDTH: Final = 9.0
_PANEL_HEIGHT: Final = 2.3
_MARGIN: Final = 1.5


def write_picture(path: Path, figure: Figure) -> None:
    """Write a figure as PNG.

    Raises:
        OSError: The file cannot be written.
    """
    draw_picture(figure).savefig(path, dpi=_DPI, metadata={"Software": None})


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
        style, colour = STYLES[k % len(STYLES)], COLOURS[k % len(COLOURS)]
        axes.plot(x, figure.columns[column], style, color=colour, linewidth=1.3, label=label)
    if panel.span is not None:
        axes.set_xlim(float(x[0]), float(x[0]) + panel.span)
    else:
        axes.margins(x=0)
    axes.xaxis.set_major_formatter(_formatter(figure.x_unit))
    axes.yaxis.set_major_formatter(_formatter(panel.unit))
    axes.set_ylabel(panel.ylabel)
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)


def _formatter(unit: str) -> Formatter:
    """Prefixes of squared units mislead, and per cent has none."""
    if unit == "m2":
        return FuncFormatter(lambda value, _position: f"{value * 1e4:.3g} cm²")
    if unit == "percent":
        return FuncFormatter(lambda value, _position: f"{value:.3g} %")
    return EngFormatter(unit)
