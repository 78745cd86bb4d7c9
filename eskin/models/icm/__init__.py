"""The ICM, an inductive-capacitive sensor (eq. 15 to 29, Table 8): MagFES and EcFES at one source.

A coil branch (R1 in series with L) and a capacitor branch (R2 in series with C) hang on the source
``V = Vm·sin(ωt + ψ)``, switched on at time 0. The state is the current i1 of the coil and the
voltage u_c of the capacitor, both from rest.
"""

from __future__ import annotations

from eskin.models.icm.parameters import IcmParameters
from eskin.models.icm.responses import ecfes_voltage, magfes_current, source_voltage
from eskin.models.icm.state_space import StateSpace, state_space

__all__ = [
    "IcmParameters",
    "StateSpace",
    "ecfes_voltage",
    "magfes_current",
    "source_voltage",
    "state_space",
]
