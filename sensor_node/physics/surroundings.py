"""Surroundings in which data sheets hold."""

from __future__ import annotations

from typing import Final

REFERENCE_TEMPERATURE: Final = 20.0
"""In °C, where a data sheet's permittivity holds."""

REFERENCE_HUMIDITY: Final = 50.0
"""In %, likewise."""
