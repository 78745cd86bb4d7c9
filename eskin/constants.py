"""Physical constants, each an interval that holds what is known of it, with its source.

Constants that are exact by definition of the SI (the speed of light) or of a standard (the
coefficients of IEC 60751 in `eskin_sensor_node.firmware.inversion.thermometer`) need no interval. A
firmware imports nothing of eskin and has its own bounds; a test compares them with these.
"""

from __future__ import annotations

import math
from typing import Final

from eskin.interval import Interval

VACUUM_PERMITTIVITY: Final = Interval(8.8541878048e-12, 8.8541878328e-12)
"""ε₀ in F/m: CODATA 2022, 8.8541878188(14)e-12, with ten times its standard uncertainty.

A standard uncertainty is no bound: from CODATA 2018 to 2022 the value moved by 4.6 of them. Ten
hold both values and cost a capacitance 1.6e-9 of its size. Source: P. J. Mohr et al., "CODATA
recommended values of the fundamental physical constants: 2022", Rev. Mod. Phys. 97 (2025) 025002.
"""
PAPER_VACUUM_PERMITTIVITY: Final = 8.854e-12
"""ε₀ in F/m with the paper's digits (below eq. 9), 21e-6 too small: for its figures alone."""
TWO_PI: Final = Interval(math.tau, math.nextafter(math.tau, 7.0))
"""2π: the float nearest to it is too small."""
