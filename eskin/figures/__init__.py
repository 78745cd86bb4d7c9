"""The paper's figures drawn anew, each with the numbers behind it (``eskin figures``)."""

from __future__ import annotations

from eskin.figures.figure import Figure, Panel
from eskin.figures.gallery import write_figures
from eskin.figures.paper import Statement

__all__ = ["Figure", "Panel", "Statement", "write_figures"]
