"""Giving memory back to the system."""

from __future__ import annotations

import ctypes


def give_back() -> None:
    """Return what the allocator keeps for later use; does nothing where it cannot (musl, macOS).

    glibc keeps freed pieces in an arena for each thread, and gives back only the ends of them.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
