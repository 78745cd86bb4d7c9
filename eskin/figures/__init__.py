"""The paper's figures drawn anew, each with the numbers behind it (``eskin figures``)."""

from __future__ import annotations

from eskin.figures.figure import Figure, Panel
from eskin.figures.gallery import FIGURES, write_figures
from eskin.figures.paper import STATEMENTS, Statement

__all__ = ["FIGURES", "STATEMENTS", "Figure", "Panel", "Statement", "write_figures"]
