"""What is before a taxel's control unit: its world, its analogue chain, its actuator."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eskin_sensor_node.kinds.registry import build_frontend, build_world

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.adaptation import Adaptation
    from eskin_sensor_node.kinds.converter import Codes
    from eskin_sensor_node.kinds.frontend import Digitised, Frontend
    from eskin_sensor_node.kinds.settings import Companion, TaxelSection
    from eskin_sensor_node.kinds.signals import Signals, World


class Drawn(NamedTuple):
    """The true parts of one taxel."""

    world: World
    frontend: Frontend


def draw(taxel: TaxelSection, seed: tuple[int, ...], companions: Mapping[str, Companion]) -> Drawn:
    """Draw them; arguments as of `SignalChain`."""
    parts = np.random.default_rng(seed)
    return Drawn(build_world(taxel, parts), build_frontend(taxel, parts, companions))


class SignalChain:
    """The true parts of one taxel; they stay the same through every reset.

    Args:
        taxel: Its settings.
        seed: Draws them.
        companions: What it reads along, by the names of its inputs.

    Attributes:
        drawn: What was drawn.
        last: Greatest code of its converter.
    """

    def __init__(
        self, taxel: TaxelSection, seed: tuple[int, ...], companions: Mapping[str, Companion]
    ) -> None:
        self.drawn = draw(taxel, seed, companions)
        self._world, self._frontend = self.drawn
        self.last = (1 << taxel.adc_bits) - 1

    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """True signals at instants since the start (a burst: since its trigger)."""
        return self._world.signals(seconds, random)

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Codes of what is sensed."""
        return self._frontend.digitise(sensed, random)

    def repeat(self, held: Floats, gain: float, trim: int) -> Codes:
        """Codes of what is held before the amplifier, with another gain and step of the trimmer."""
        return self._frontend.repeat(held, gain, trim)

    def adjust(self, chosen: Adaptation) -> None:
        """Set amplifier, trimmer and plates as the control unit has chosen."""
        self._frontend.adjust(chosen.gain, chosen.trim)
        self._world.move(chosen.plate)
