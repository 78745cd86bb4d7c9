"""Which world a taxel lives in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from eskin_sensor_node.physics.air import AirWorld, BodyWorld
from eskin_sensor_node.physics.capacitive import CapacitiveWorld
from eskin_sensor_node.physics.coil import CoilWorld
from eskin_sensor_node.physics.hybrid import HybridWorld
from eskin_sensor_node.physics.inductive import InductiveWorld
from eskin_sensor_node.physics.pad import PadWorld
from eskin_sensor_node.physics.recorded import RecordedWorld
from eskin_sensor_node.physics.touch import TouchWorld
from eskin_sensor_node.taxels import (
    BioelectricSection,
    CoilSection,
    HarmonicSection,
    HygrometerSection,
    PadSection,
    RecordedCapacitanceSection,
    RecordedInductanceSection,
    SwingSection,
    ThermometerSection,
    TouchSection,
)

if TYPE_CHECKING:
    import numpy as np

    from eskin.interval import Floats
    from eskin_sensor_node.physics.signals import Signals
    from eskin_sensor_node.taxels import AnyTaxel


class World(Protocol):
    """True parts and true signals of one taxel."""

    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """True signals at instants since the start (a burst: since its trigger)."""


def build_world(taxel: AnyTaxel, random: np.random.Generator) -> World:
    """Draw the true parts of a taxel's world."""
    world: World
    match taxel:
        case HarmonicSection():
            world = CapacitiveWorld(taxel, random)
        case PadSection():
            world = PadWorld(taxel, random)
        case RecordedCapacitanceSection():
            world = RecordedWorld(taxel, "capacitance", random)
        case TouchSection():
            world = TouchWorld(taxel, random)
        case SwingSection():
            world = InductiveWorld(taxel, random)
        case CoilSection():
            world = CoilWorld(taxel, random)
        case RecordedInductanceSection():
            world = RecordedWorld(taxel, "inductance", random)
        case ThermometerSection() | HygrometerSection():
            world = AirWorld(taxel)
        case BioelectricSection():
            world = BodyWorld(taxel)
        case _:
            world = HybridWorld(taxel, random)
    return world
