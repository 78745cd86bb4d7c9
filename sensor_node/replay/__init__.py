"""Replay: recordings from elsewhere that travel the same path as emulated physics."""

from __future__ import annotations

from sensor_node.replay.recording import Recording, Series, read_recording
from sensor_node.replay.section import Recorded

__all__ = ["Recorded", "Recording", "Series", "read_recording"]
