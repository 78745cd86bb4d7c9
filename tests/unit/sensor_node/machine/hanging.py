"""Firmware that hangs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.firmware.control_unit import ControlUnit

if TYPE_CHECKING:
    import pytest
    from eskin_sensor_node.firmware.autoranging import Readings
    from eskin_sensor_node.firmware.channel import ChannelUnit
    from eskin_sensor_node.firmware.schedule import Frame


def hang(monkeypatch: pytest.MonkeyPatch, taxel: str, number: int) -> None:
    """Let the firmware fail once, at a taxel's frame after so many of them."""
    process = ControlUnit.process
    seen = 0

    def failing(unit: ControlUnit, frame: Frame, readings: Readings) -> list[ChannelUnit]:
        nonlocal seen
        seen += unit.name == taxel
        if unit.name == taxel and seen == number + 1:
            raise IndexError("index out of range")
        return process(unit, frame, readings)

    monkeypatch.setattr(ControlUnit, "process", failing)
