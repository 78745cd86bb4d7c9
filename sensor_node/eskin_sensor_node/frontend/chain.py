"""Which analogue chain a taxel has."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.frontend.air import HygrometerFrontend, ThermometerFrontend
from eskin_sensor_node.frontend.bioelectric import BioelectricFrontend
from eskin_sensor_node.frontend.coil import CoilFrontend
from eskin_sensor_node.frontend.companions import CompaniedFrontend
from eskin_sensor_node.frontend.hybrid import LinearFrontend
from eskin_sensor_node.frontend.oscillator import LcFrontend, RcFrontend
from eskin_sensor_node.taxels import (
    BioelectricSection,
    CapacitiveSection,
    CoilSection,
    HygrometerSection,
    InductiveSection,
    ThermometerSection,
    TouchSection,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin_sensor_node.frontend.amplified import Frontend
    from eskin_sensor_node.taxels import AnyTaxel
    from eskin_sensor_node.taxels.companion import Companion


def build_frontend(
    taxel: AnyTaxel,
    random: np.random.Generator,
    companions: Mapping[str, Companion] | None = None,
) -> Frontend:
    """Draw the true parts of a taxel's analogue chain.

    Args:
        taxel: Its data sheet.
        random: Draws them.
        companions: What it reads along, by the names of its inputs.
    """
    own = _frontend(taxel, random)
    if not companions:
        return own
    return CompaniedFrontend(
        own,
        {
            name: _frontend(each.taxel, np.random.default_rng(each.seed))
            for name, each in companions.items()
        },
    )


def _frontend(taxel: AnyTaxel, random: np.random.Generator) -> Frontend:
    made: Frontend
    match taxel:
        case CapacitiveSection():
            made = RcFrontend(taxel, random, noise=taxel.noise)
        case TouchSection():
            # It is disturbed at the plate, not behind it.
            made = RcFrontend(taxel, random, noise=None)
        case CoilSection():
            made = CoilFrontend(taxel, random)
        case InductiveSection():
            made = LcFrontend(taxel, random)
        case ThermometerSection():
            made = ThermometerFrontend(taxel, random)
        case HygrometerSection():
            made = HygrometerFrontend(taxel, random)
        case BioelectricSection():
            made = BioelectricFrontend(taxel, random)
        case _:
            made = LinearFrontend(taxel, random)
    return made
