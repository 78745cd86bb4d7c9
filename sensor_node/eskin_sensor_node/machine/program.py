"""What the program takes of the microcontroller's own flash."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.errors import SettingsError

if TYPE_CHECKING:
    from eskin_sensor_node.settings import NodeSettings

FIRMWARE: Final = 64_207
"""Bytes of all modules of the firmware, compiled by mpy-cross 1.27 as they stand."""
INTERPRETER: Final = 256 * 1024
"""Bytes kept for MicroPython, which "fits and runs within just 256k of code space"."""


def require_flash(settings: NodeSettings) -> None:
    """Refuse a machine that cannot hold its program.

    Raises:
        SettingsError: It has less flash.
    """
    limit, need = settings.machine.flash_bytes, FIRMWARE + INTERPRETER
    if need > limit:
        raise SettingsError(
            "machine.flash_bytes",
            f"{limit} bytes do not hold the program, which needs {need} (firmware {FIRMWARE}, "
            f"interpreter {INTERPRETER}); use a machine with more flash",
        )
