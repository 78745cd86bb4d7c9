"""The signal chain before a taxel's control unit: world, analogue front end, actuator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.kinds.registry import build_frontend, build_world

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin_sensor_node.firmware.adaptation import Adaptation
    from eskin_sensor_node.kinds.settings import Companion, TaxelSection


class SignalChain:
    """The true parts of one taxel; they stay the same through every reset.

    Args:
        taxel: Its settings.
        seed: Draws them.
        companions: What it reads along, by the names of its inputs.

    Attributes:
        world: Gives the true signals at instants since the start (a burst: since its trigger).
        frontend: Turns signals into codes.
        last: Greatest code of its converter.
    """

    def __init__(
        self, taxel: TaxelSection, seed: tuple[int, ...], companions: Mapping[str, Companion]
    ) -> None:
        parts = np.random.default_rng(seed)
        self.world = build_world(taxel, parts)
        self.frontend = build_frontend(taxel, parts, companions)
        self.last = (1 << taxel.adc_bits) - 1

    def adjust(self, chosen: Adaptation) -> None:
        """Set amplifier, trimmer and plates as the control unit has chosen."""
        self.frontend.adjust(chosen.gain, chosen.trim)
        self.world.move(chosen.plate)
