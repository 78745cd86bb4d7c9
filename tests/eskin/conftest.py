"""Compiled functions take their time at the first call, so hypothesis sets no deadline here."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("compiled", deadline=None)
settings.load_profile("compiled")
