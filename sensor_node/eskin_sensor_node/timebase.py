"""Nanoseconds of a second."""

from __future__ import annotations

from typing import Final

BILLION: Final = 1_000_000_000
