"""Settings of a taxel (one sensing element): a ``[[taxel]]`` table of a node's file."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import Field

from eskin_sensor_node.taxels.air import HygrometerSection, ThermometerSection
from eskin_sensor_node.taxels.bioelectric import BioelectricSection
from eskin_sensor_node.taxels.capacitive import (
    CapacitiveSection,
    HarmonicSection,
    PadSection,
    RecordedCapacitanceSection,
    TouchSection,
)
from eskin_sensor_node.taxels.hybrid import HybridSection
from eskin_sensor_node.taxels.inductive import (
    CoilSection,
    InductiveSection,
    RecordedInductanceSection,
    SwingSection,
)
from eskin_sensor_node.taxels.settings import TaxelSection, period

AnyTaxel: TypeAlias = (
    HarmonicSection
    | PadSection
    | RecordedCapacitanceSection
    | TouchSection
    | SwingSection
    | CoilSection
    | RecordedInductanceSection
    | HybridSection
    | ThermometerSection
    | HygrometerSection
    | BioelectricSection
)
"""A taxel of any kind."""

Taxel: TypeAlias = Annotated[AnyTaxel, Field(discriminator="kind")]
"""The same, told apart by ``kind`` when read."""

__all__ = [
    "AnyTaxel",
    "BioelectricSection",
    "CapacitiveSection",
    "CoilSection",
    "HarmonicSection",
    "HybridSection",
    "HygrometerSection",
    "InductiveSection",
    "PadSection",
    "RecordedCapacitanceSection",
    "RecordedInductanceSection",
    "SwingSection",
    "Taxel",
    "TaxelSection",
    "ThermometerSection",
    "TouchSection",
    "period",
]
