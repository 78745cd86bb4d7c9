"""Values in a job, as every port reads them alike."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.wire.messages.command import State


def described_settings(state: State) -> list[Any]:
    """Place, name, whether it is a number, and the value of each setting."""
    return [
        [place, name, type(value) is float, text(value)]
        for place, settings in state.items()
        for name, value in settings.items()
    ]


def text(value: float | str) -> str:
    return hexadecimal(value) if type(value) is float else str(value)


def hexadecimal(value: float) -> str:
    """A float that every port reads alike."""
    return struct.pack("<d", value).hex()


def hexadecimals(values: Mapping[str, float]) -> dict[str, str]:
    return {name: hexadecimal(value) for name, value in values.items()}
