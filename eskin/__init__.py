"""eskin: smart skin sensors from the physics to the pixel, every value an interval.

``import eskin`` gives a researcher's notebook the intervals, the tubes and their peaks, and the
contacts and gestures of a skin, with no server. The sensor models are in `eskin.models`, noise and
detection in `eskin.noise`, design by intervals in `eskin.design`, formulas over time in
`eskin.monitor`, wear in `eskin.identification`. `eskin.connect` opens an `eskin.Client`, which
reads a cloud's data.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from eskin import design, identification, models, monitor, noise
    from eskin.client import Client, connect
    from eskin.contacts import (
        Contacts,
        ContactStream,
        ContactTracks,
        Skin,
        find_contacts,
        link_contacts,
        track_contacts,
    )
    from eskin.errors import EskinError
    from eskin.gestures import Gestures, GestureStream, find_gestures
    from eskin.interval import Interval, Verdict, Verdicts
    from eskin.peaks import PeakEvent, Peaks, PeakStream, find_peaks
    from eskin.tube import Tube

__all__ = [
    "Client",
    "ContactStream",
    "ContactTracks",
    "Contacts",
    "EskinError",
    "GestureStream",
    "Gestures",
    "Interval",
    "PeakEvent",
    "PeakStream",
    "Peaks",
    "Skin",
    "Tube",
    "Verdict",
    "Verdicts",
    "connect",
    "design",
    "find_contacts",
    "find_gestures",
    "find_peaks",
    "identification",
    "link_contacts",
    "models",
    "monitor",
    "noise",
    "track_contacts",
]

_ROOMS: Final = {
    "eskin.client": ("Client", "connect"),
    "eskin.contacts": (
        *("ContactStream", "ContactTracks", "Contacts", "Skin"),
        *("find_contacts", "link_contacts", "track_contacts"),
    ),
    "eskin.errors": ("EskinError",),
    "eskin.gestures": ("GestureStream", "Gestures", "find_gestures"),
    "eskin.interval": ("Interval", "Verdict", "Verdicts"),
    "eskin.peaks": ("PeakEvent", "PeakStream", "Peaks", "find_peaks"),
    "eskin.tube": ("Tube",),
}
_ROOM_OF: Final = {name: room for room, names in _ROOMS.items() for name in names}
_LATER: Final = frozenset(__all__) - _ROOM_OF.keys()
"""Rooms that are attributes themselves."""


def __getattr__(name: str) -> Any:
    """Import a room at its first use (PEP 562): NumPy and Numba take most of a second."""
    if name in _ROOM_OF:
        return getattr(importlib.import_module(_ROOM_OF[name]), name)
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return importlib.import_module(f"{__name__}.{name}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
