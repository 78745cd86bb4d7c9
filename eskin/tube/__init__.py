"""Tubes: interval-valued signals over time (the term of interval analysis; see codac)."""

from __future__ import annotations

from eskin.tube.tube import Tube

__all__ = ["Tube"]
