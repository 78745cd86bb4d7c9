"""Colours and axes that all pictures share; needs matplotlib, which is an extra."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from matplotlib.ticker import EngFormatter, FuncFormatter

if TYPE_CHECKING:
    from matplotlib.ticker import Formatter

COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Okabe and Ito's colours, distinct for the colour-blind, too."""
_FACTORS: Final = {"m2": (1e4, "cm²"), "percent": (1.0, "%"), "F": (1e12, "pF")}


def axis_formatter(unit: str) -> Formatter:
    """Ticks with their unit.

    Prefixes of squared units mislead, per cent has none, and the paper has picofarads.
    """
    if unit in _FACTORS:
        factor, name = _FACTORS[unit]
        return FuncFormatter(
            lambda value, _position: f"{value * factor:.3g} {name}".replace("-", "−")
        )
    return EngFormatter(unit)
