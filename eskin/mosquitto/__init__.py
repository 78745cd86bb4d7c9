"""Mosquitto as our broker: its configuration, access lists, and the files it reads anew."""

from __future__ import annotations

from eskin.mosquitto.configuration import BrokerPorts, configuration, revoked, versions
from eskin.mosquitto.program import find_mosquitto

__all__ = ["BrokerPorts", "configuration", "find_mosquitto", "revoked", "versions"]
