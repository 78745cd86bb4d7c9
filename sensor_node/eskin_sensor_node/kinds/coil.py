"""Coils of a skin that see metal (eq. 11 of the paper), by frequency and by eddy currents.

Metal before a coil is a loop that is coupled to it: with the reactance over resistance q of its
eddy currents it reflects ``ΔZ = ω·ΔL·e^(-αd)·(1/q - j)`` into the coil. Its imaginary part is
eq. 11's fall of the inductance; its real part is the metal's loss. So a coil that is fed with a
fixed voltage changes its current in amplitude and phase: by ``|Z0|/|Z|`` and ``arg Z0 - arg Z``
with ``Z0 = R + jωL0`` and ``Z = Z0 + ΔZ``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final, Literal

import numpy as np
from pydantic import Field

from eskin_sensor_node.firmware.taxel.coil import CoilTaxel
from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Digitised
from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.lc import LcFrontend, LcSection
from eskin_sensor_node.kinds.parameters import draw_noise, draw_part
from eskin_sensor_node.kinds.settings import Positive, Tolerance, unit
from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import Stage, read_scenario
from eskin_sensor_node.world.scenario.fit import Staged
from eskin_sensor_node.world.skin import break_off, placed

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.world.scenario import Stimulus


class CoilSection(Staged, LcSection):
    """Coil in a skin that sees metal as a scenario has it. Noise: in V, before each ADC."""

    firmware: ClassVar[type[CoilTaxel]] = CoilTaxel
    disturbances: ClassVar[int] = 2

    kind: Literal["coil"]
    coil_resistance_ohm: Positive = Field(default=5.0, description="its loss resistance")
    coil_resistance_tolerance: Tolerance = 5e-3
    excitation: Positive = unit(
        "excitation_Hz", 1000.0, description="frequency at which eddy currents are seen"
    )
    excitation_tolerance: Tolerance = 1e-5
    drive: Positive = unit("drive_V", 1.0, description="amplitude of the excitation")
    drive_tolerance: Tolerance = 1e-3
    demodulator_gain: Positive = unit("demodulator_gain_V_per_A", 30.0)
    demodulator_gain_tolerance: Tolerance = 1e-3
    demodulator_max: Positive = unit(
        "demodulator_max_V", 1.25, description="upper end of its converters' range, from 0 V"
    )
    eddy_amplitude_prominence: Positive | None = None
    eddy_phase_prominence: Positive | None = unit("eddy_phase_prominence_rad", None)


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


class CoilFrontend(LcFrontend):
    """Beside the oscillator's: the coil's driven current → two synchronous demodulators → ADCs."""

    def __init__(self, taxel: CoilSection, random: ColumnGenerator) -> None:
        super().__init__(taxel, random)
        drive = draw_part(random, taxel.drive, taxel.drive_tolerance)
        self._drive = drive * draw_part(
            random, taxel.demodulator_gain, taxel.demodulator_gain_tolerance
        )
        # No amplifier and no trimmer before them.
        own = taxel.model_copy(
            update={
                "adc_min": 0.0,
                "adc_max": taxel.demodulator_max,
                "gain_tolerance": 0.0,
                "trimmer_steps": 0,
            }
        )
        self._demodulators = {
            "in_phase": ("conductance", Converter(own, random)),
            "quadrature": ("susceptance", Converter(own, random)),
        }

    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Codes of the detector's voltage, and of the current's two parts."""
        oscillator = super().digitise(sensed, random)
        codes = {
            name: converter.convert(self._drive * sensed[part] + draw_noise(random, self._noise))
            for name, (part, converter) in self._demodulators.items()
        }
        return Digitised(oscillator.truth, oscillator.codes | codes, oscillator.held)


COIL = Kind(settings=CoilSection, world=CoilWorld, frontend=CoilFrontend)
