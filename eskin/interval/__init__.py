"""Intervals: arrays of closed bounds that enclose the truth, by the words of IEEE 1788-2015."""

from __future__ import annotations

from eskin.interval.conversion import Floats, require_plain, round_down, round_up
from eskin.interval.decoration import DomainWatch, watch_domains
from eskin.interval.interval import Interval, as_interval
from eskin.interval.verdict import Verdict, Verdicts

__all__ = [
    "DomainWatch",
    "Floats",
    "Interval",
    "Verdict",
    "Verdicts",
    "as_interval",
    "require_plain",
    "round_down",
    "round_up",
    "watch_domains",
]
