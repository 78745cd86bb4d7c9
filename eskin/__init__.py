"""eskin: smart skin sensors from the physics to the pixel, every value an interval.

``import eskin`` gives a researcher's notebook the intervals, the tubes, their peaks and the wire
contract, with no server. The sensor models stand in `eskin.models`, noise and detection in
`eskin.noise`, design by intervals in `eskin.design`; `eskin.connect` reads a cloud's data.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

from eskin.errors import EskinError
from eskin.interval import Answer, Interval
from eskin.messages import Block, Encoding, decode_message
from eskin.peaks import PeakEvent, Peaks, PeakStream, Verdict, find_peaks
from eskin.tube import Tube

if TYPE_CHECKING:
    from eskin import design, models, noise
    from eskin.client import connect

__all__ = [
    "Answer",
    "Block",
    "Encoding",
    "EskinError",
    "Interval",
    "PeakEvent",
    "PeakStream",
    "Peaks",
    "Tube",
    "Verdict",
    "connect",
    "decode_message",
    "design",
    "find_peaks",
    "models",
    "noise",
]

_LATER: Final = frozenset({"design", "models", "noise"})


def __getattr__(name: str) -> Any:
    """Import a room at its first use (PEP 562): intervals alone are there in half the time."""
    if name == "connect":
        return importlib.import_module("eskin.client").connect
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return importlib.import_module(f"{__name__}.{name}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
