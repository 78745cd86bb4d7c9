"""Design by intervals: which parameters certainly meet a requirement, possibly, and never."""

from __future__ import annotations

from eskin.design.dual import Dual
from eskin.design.inversion import invert, progress_bar
from eskin.design.paving import Paving, Region
from eskin.design.plot import draw_paving
from eskin.design.requirement import All, Judgement, Narrower, Requirement, Within
from eskin.design.sensitivity import Sensitivity, sensitivity

__all__ = [
    "All",
    "Dual",
    "Judgement",
    "Narrower",
    "Paving",
    "Region",
    "Requirement",
    "Sensitivity",
    "Within",
    "draw_paving",
    "invert",
    "progress_bar",
    "sensitivity",
]
