"""Chains that a taxel reads along."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.frontend.amplified import Digitised

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from eskin.interval import Floats
    from eskin_sensor_node.frontend.amplified import Frontend
    from eskin_sensor_node.machine.converter import Codes


class CompaniedFrontend:
    """A chain, and others with one input each that are sampled at the same instants.

    Args:
        own: The taxel's chain; it alone is adjusted.
        companions: Name of the input to the chain.
    """

    def __init__(self, own: Frontend, companions: Mapping[str, Frontend]) -> None:
        self._own = own
        self._companions = companions

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Codes of all."""
        own = self._own.digitise(sensed, random)
        codes = dict(own.codes)
        for name, companion in self._companions.items():
            (codes[name],) = companion.digitise(sensed, random).codes.values()
        return Digitised(own.truth, codes, own.held)

    def adjust(self, gain: float, trim: int) -> None:
        """Set the amplifier before the taxel's own converter, and its trimmer."""
        self._own.adjust(gain, trim)

    def repeat(self, held: Floats, gain: float, trim: int) -> Codes:
        """Codes of what is held before the taxel's own amplifier."""
        return self._own.repeat(held, gain, trim)
