"""eskin: smart skin sensors from the physics to the pixel, every value an interval.

``import eskin`` gives a researcher's notebook the intervals, the tubes, their peaks and the wire
contract, with no server. The sensor models stand in `eskin.models`.
"""

from __future__ import annotations

from eskin.errors import EskinError
from eskin.interval import Interval
from eskin.messages import Block, Encoding, decode_message
from eskin.peaks import PeakDetector, PeakEvent, Verdict, find_peaks
from eskin.tube import Tube

__all__ = [
    "Block",
    "Encoding",
    "EskinError",
    "Interval",
    "PeakDetector",
    "PeakEvent",
    "Tube",
    "Verdict",
    "decode_message",
    "find_peaks",
]
