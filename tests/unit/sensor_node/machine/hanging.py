"""Firmware that hangs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.firmware.control_unit import ControlUnit

if TYPE_CHECKING:
    import pytest
    from eskin_sensor_node.firmware.autoranging import Readings
    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.schedule import Frame


def hang(monkeypatch: pytest.MonkeyPatch, taxel: str, number: int) -> None:
    """Let the firmware fail once, at a frame or, where that one is left out, at the next."""
    process = ControlUnit.process
    left = [1]

    def failing(unit: ControlUnit, frame: Frame, readings: Readings) -> list[Record]:
        if unit.name == taxel and frame.number >= number and left:
            left.pop()
            raise IndexError("index out of range")
        return process(unit, frame, readings)

    monkeypatch.setattr(ControlUnit, "process", failing)
