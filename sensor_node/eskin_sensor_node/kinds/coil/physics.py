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
from eskin_sensor_node.world.skin import break_off

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.coil.settings import CoilSection
    from eskin_sensor_node.world.scenario import Stimulus
    from eskin_sensor_node.world.skin import FaultSection

_OPEN_LINE: Final = 1e6
"""Inductance in H of a line that is broken: the oscillator stands almost still."""


class Coils:
    """Some coils with their true parts, each a row of an array.

    Args:
        taxels: Their data sheets.
        randoms: Draw the true parts, one generator for each.
        stage: Plays their scenario for them, in this order.
        faults: Those of the scenario.
    """

    def __init__(
        self,
        taxels: Sequence[CoilSection],
        randoms: Sequence[np.random.Generator],
        *,
        stage: Stage,
        faults: Sequence[FaultSection],
    ) -> None:
        parts = [_draw(taxel, random) for taxel, random in zip(taxels, randoms, strict=True)]
        base, change, damping, self._resistance, hertz = np.array(parts).T[:, :, None]
        self._base, self._change, self._damping = base, change, damping
        self._omega = 2.0 * np.pi * hertz
        rows = {taxel.place: row for row, taxel in enumerate(taxels)}
        self._faults = [(rows[fault.taxel], fault) for fault in faults if fault.taxel in rows]
        self._stage = stage

    def truth(self, seconds: Floats) -> tuple[dict[str, Floats], Stimulus]:
        """What is at some times, each quantity an array of coils × times, and what caused it.

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


class CoilWorld(World):
    """One coil of a node."""

    def __init__(self, taxel: CoilSection, random: np.random.Generator) -> None:
        script = read_scenario(taxel.scenario)
        stage = Stage(script, [taxel.place])
        self._coils = Coils([taxel], [random], stage=stage, faults=script.fault)

    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """True inductance in H, distance in m, amplitude, phase in rad, parts of 1/Z in S."""
        del random
        truth = {name: values[0] for name, values in self._coils.truth(seconds)[0].items()}
        return Signals(truth, truth)


def _draw(taxel: CoilSection, random: np.random.Generator) -> tuple[float, ...]:
    """Inductance without metal, its greatest change, damping, resistance, excitation."""
    return (
        draw_part(random, taxel.inductance, taxel.inductance_tolerance),
        draw_part(random, taxel.inductance_change, taxel.inductance_change_tolerance),
        draw_part(random, taxel.damping_per_m, taxel.damping_tolerance),
        draw_part(random, taxel.coil_resistance_ohm, taxel.coil_resistance_tolerance),
        draw_part(random, taxel.excitation, taxel.excitation_tolerance),
    )
