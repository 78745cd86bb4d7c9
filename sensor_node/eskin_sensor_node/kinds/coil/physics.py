"""Coils of a skin that see metal (eq. 11 of the paper), by frequency and by eddy currents.

Metal before a coil is a loop that is coupled to it: with the reactance over resistance q of its
eddy currents it reflects ``ΔZ = ω·ΔL·e^(-αd)·(1/q - j)`` into the coil. Its imaginary part is
eq. 11's fall of the inductance; its real part is the metal's loss. So a coil that is fed with a
fixed voltage changes its current in amplitude and phase: by ``|Z0|/|Z|`` and ``arg Z0 - arg Z``
with ``Z0 = R + jωL0`` and ``Z = Z0 + ΔZ``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin_sensor_node.kinds.parameters import draw_part
from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import Stage, read_scenario
from eskin_sensor_node.world.skin import break_off, placed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.coil.settings import CoilSection
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.world.scenario import Stimulus

_OPEN_LINE: Final = 1e6
"""Inductance in H of a line that is broken: the oscillator stands almost still."""


class CoilWorld(World):
    """Coils of a skin.

    Args:
        taxel: Their data sheet.
        random: Draws a column of a part at once.
        places: Where they are in their skin: coils of one node, or all at one place, in many nodes.
        stage: Plays their scenario for them; ``None``: as the data sheet has it.
    """

    def __init__(
        self,
        taxel: CoilSection,
        random: ColumnGenerator,
        places: Sequence[str],
        *,
        stage: Stage | None = None,
    ) -> None:
        script = read_scenario(taxel.scenario)
        self._base = draw_part(random, taxel.inductance, taxel.inductance_tolerance)
        self._change = draw_part(random, taxel.inductance_change, taxel.inductance_change_tolerance)
        self._damping = draw_part(random, taxel.damping_per_m, taxel.damping_tolerance)
        self._resistance = draw_part(
            random, taxel.coil_resistance_ohm, taxel.coil_resistance_tolerance
        )
        self._omega = 2.0 * np.pi * draw_part(random, taxel.excitation, taxel.excitation_tolerance)
        self._faults = placed(script.fault, places)
        self._stage = stage or Stage(script, list(dict.fromkeys(places)))

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """Truth as `truth` has it, all of which is sensed."""
        del random
        truth, _ = self.truth(seconds)
        return Signals(truth, truth)

    def truth(self, seconds: Floats) -> tuple[dict[str, Floats], Stimulus]:
        """What is at some times, each quantity an array of columns × times, and what caused it.

        Returns:
            Inductance at the oscillator in H (with faults), distance of the metal in m; what eddy
            currents make of the coil's current: its amplitude over the one without metal, its
            change of phase in rad; and the parts of 1/Z, its conductance and its susceptance
            (inductive: positive), in S.
        """
        stimulus = self._stage.stimulus(seconds)
        fall = self._fall(stimulus)
        resistance = self._resistance + self._omega * fall / stimulus.metal_quality
        before = self._resistance + 1j * self._omega * self._base
        after = resistance + 1j * self._omega * (self._base - fall)
        inductance = self._base - fall
        if self._faults:
            break_off(
                inductance,
                seconds,
                self._faults,
                intact=lambda then: self._base - self._fall(self._stage.stimulus(then)),
                dead=_OPEN_LINE,
            )
        admittance = 1.0 / after
        truth = {
            "inductance": inductance,
            "distance": stimulus.metal_distance,
            "eddy_amplitude": np.abs(before) / np.abs(after),
            "eddy_phase": np.angle(before) - np.angle(after),
            "conductance": admittance.real,
            "susceptance": -admittance.imag,
        }
        return truth, stimulus

    def _fall(self, stimulus: Stimulus) -> Floats:
        """``ΔL·e^(-αd)`` in H."""
        return np.asarray(self._change * np.exp(-self._damping * stimulus.metal_distance))
