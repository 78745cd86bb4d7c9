"""A fleet as a real process."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.identity import IdentityKind, numbered
from tests.support.files import write_settings
from tests.support.processes import ESKIN, Running

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities

TAXEL = """\
[[taxel]]
id = "t01"
kind = "capacitive"
capacitance_min_F = 10e-12
capacitance_max_F = 100e-12
stimulus_Hz = {stimulus}
sampling_Hz = {sampling}
resistance_ohm = 1e3
resistance_tolerance = 1e-3
reference_Hz = 20e6
reference_tolerance = 1e-5
transconductance_A_per_V = 1e-3
transconductance_tolerance = 1e-3
adc_gain_error = 1e-4
adc_offset_error = 0.2
adc_nonlinearity = 0.3
noise = {{ kind = "uniform", bound = 1e-7 }}
capacitance_prominence_F = 40e-12
"""


def enrol(identities: Identities, names: list[str]) -> None:
    """An identity for each node."""
    for name in names:
        identities.make(IdentityKind.NODE, name)


class RunningFleet(Running):
    """``eskin node --count N``.

    Attributes:
        names: Of its nodes.
        flash: Its storage.
        truth: What its emulator keeps.
    """

    def __init__(
        self,
        folder: Path,
        pki: Path,
        *,
        port: int,
        count: int,
        sampling: float = 1000.0,
        stimulus: float = 2.0,
        stretch_ms: float = 100.0,
        status: float = 5.0,
        site: Path | None = None,
        **sections: dict[str, object],
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.names = numbered("skin", count)
        self.flash, self.truth = folder / "flash.sqlite", folder / "truth.sqlite"
        config = write_settings(folder / "fleet.toml", {
            "node": {"name": "skin", "profile": "patch", "seed": 11},
            "sampling": {"overrun_s": 30.0, "stretch_ms": stretch_ms},
            "broker": {"port": port, "status_s": status, "keepalive_s": 60, "drain_s": 60.0},
            "identity": {"directory": pki, "site": site or pki / "site.main" / "chain.pem"},
            "flash": {"path": self.flash},
            "truth": {"path": self.truth},
            **sections,
        })  # fmt: skip
        with config.open("a") as file:
            file.write(TAXEL.format(sampling=float(sampling), stimulus=float(stimulus)))
        argv = [ESKIN, "node", "--config", str(config), "--count", str(count)]
        super().__init__(argv, log=folder / "fleet.log")
