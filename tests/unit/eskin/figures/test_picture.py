"""What is drawn is what the figure says: its numbers, units, labels and words."""

from __future__ import annotations

import numpy as np
import pytest

from eskin.figures.gallery import FIGURES
from eskin.figures.plot import draw_picture


@pytest.mark.parametrize("name", FIGURES)
def test_panels_show_their_columns_under_their_labels(name: str) -> None:
    figure = FIGURES[name]()
    canvas = draw_picture(figure)
    x = next(iter(figure.columns.values()))
    assert canvas.get_suptitle() == figure.title
    assert " ".join(canvas.get_supxlabel().split()) == figure.caption
    assert canvas.axes[-1].get_xlabel() == figure.xlabel
    for axes, panel in zip(canvas.axes, figure.panels, strict=True):
        assert axes.get_ylabel() == panel.ylabel
        legend = axes.get_legend()
        assert legend is not None
        assert [text.get_text() for text in legend.get_texts()] == [*panel.bands, *panel.lines]
        assert axes.get_xlim() == pytest.approx(panel.window or (x[0], x[-1]))
        assert axes.get_yscale() == ("linear" if panel.logarithmic is None else "log")
        assert len(axes.lines) == len(panel.lines)
        for line, (label, column) in zip(axes.lines, panel.lines.items(), strict=True):
            assert line.get_label() == label
            np.testing.assert_array_equal(np.asarray(line.get_xdata()), x)
            np.testing.assert_array_equal(np.asarray(line.get_ydata()), figure.columns[column])
        for area, (label, ends) in zip(axes.collections, panel.bands.items(), strict=True):
            assert area.get_label() == label
            corners = np.asarray(area.get_paths()[0].vertices)
            lo, hi = (figure.columns[end] for end in ends)
            assert (corners[:, 1].min(), corners[:, 1].max()) == (lo.min(), hi.max())


@pytest.mark.parametrize(
    ("name", "axis", "value", "text"),
    [
        ("fig4a", "yaxis", 2e-4, "200 µJ"),
        ("fig4b", "xaxis", 3e-3, "3 mm"),
        ("fig8", "yaxis", 1e-4, "1 cm²"),
        ("fig7b", "yaxis", 2e-13, "0.2 pF"),
        ("error_rates_noise", "xaxis", 2e-6, "0.02 cm²"),
        ("error_rates_noise", "yaxis", 25.0, "25 %"),
    ],
)
def test_axes_have_units_that_one_reads(name: str, axis: str, value: float, text: str) -> None:
    axes = draw_picture(FIGURES[name]()).axes[0]
    assert getattr(axes, axis).get_major_formatter()(value, 0) == text
