"""Constants of nature that the world and the firmware agree on."""

from __future__ import annotations

import math
from typing import Final

from eskin.interval import Interval

EPSILON_0: Final = 8.854e-12
"""Permittivity of vacuum in F/m, with the paper's digits (below eq. 9)."""

REFERENCE_TEMPERATURE: Final = 20.0
"""In °C, where a data sheet's permittivity holds."""

REFERENCE_HUMIDITY: Final = 50.0
"""In %, likewise."""

TWO_PI: Final = Interval(math.nextafter(2 * math.pi, 0.0), math.nextafter(2 * math.pi, 7.0))
"""An enclosure of 2π."""

SECOND: Final = 1_000_000_000
"""In the clock's ticks (ns)."""
