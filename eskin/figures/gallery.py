"""All figures, and how they are written."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING, Final

from eskin.figures.alternating_source import draw_fig6
from eskin.figures.error_rates import draw_error_rates_noise, draw_error_rates_threshold
from eskin.figures.hybrid import draw_fig10a, draw_fig10b
from eskin.figures.inductive import draw_fig9
from eskin.figures.magnetic_energy import draw_fig4a
from eskin.figures.measuring_chain import draw_fig5a, draw_fig5b
from eskin.figures.paper import write_statements
from eskin.figures.plate_capacitance import draw_fig4b, draw_fig7a, draw_fig7b
from eskin.figures.touch import draw_fig8
from eskin.figures.touch_design import write_design

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from eskin.figures.figure import Figure, Floats

FIGURES: Final[dict[str, Callable[[], Figure]]] = {
    "fig4a": draw_fig4a,
    "fig4b": draw_fig4b,
    "fig5a": draw_fig5a,
    "fig5b": draw_fig5b,
    "fig6": draw_fig6,
    "fig7a": draw_fig7a,
    "fig7b": draw_fig7b,
    "fig8": draw_fig8,
    "fig9": draw_fig9,
    "fig10a": draw_fig10a,
    "fig10b": draw_fig10b,
    "error_rates_threshold": draw_error_rates_threshold,
    "error_rates_noise": draw_error_rates_noise,
}


def write_figures(
    directory: Path, *, progress: Callable[[str, int, int], None] = lambda _name, _done, _all: None
) -> list[Path]:
    """Write every figure as PNG and CSV, ``design.png`` of docs/theory.md, and ``paper.csv``.

    Args:
        directory: Made where it is missing.
        progress: Called with what comes next, how many are done, and how many there are.

    Returns:
        The files.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: The folder or a file cannot be written.
    """
    from eskin.figures.plot import write_picture  # noqa: PLC0415 - matplotlib is an extra

    directory.mkdir(parents=True, exist_ok=True)
    written = []
    for done, (name, draw) in enumerate(FIGURES.items()):
        progress(name, done, len(FIGURES))
        figure = draw()
        table, picture = directory / f"{name}.csv", directory / f"{name}.png"
        write_table(table, figure.columns)
        write_picture(picture, figure)
        written += [table, picture]
    written.append(write_design(directory / "design.png"))
    written.append(write_statements(directory / "paper.csv"))
    progress("paper", len(FIGURES), len(FIGURES))
    return written


def write_table(path: Path, columns: Mapping[str, Floats]) -> None:
    """Write columns of one length below their headers.

    Raises:
        OSError: The file cannot be written.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        writer.writerows([repr(value) for value in row] for row in rows)
