"""Replay: recordings from elsewhere that travel the same path as emulated physics."""

from __future__ import annotations

from eskin_sensor_node.world.replay.recording import RecordedSeries, Recording, read_recording
from eskin_sensor_node.world.replay.settings import Recorded

__all__ = ["Recorded", "RecordedSeries", "Recording", "read_recording"]
