"""eskin: smart skin sensors from the physics to the pixel, every value an interval.

``import eskin`` gives a researcher's notebook the intervals, the tubes, their peaks and the wire
contract, with no server. The sensor models stand in `eskin.models`, noise and detection in
`eskin.noise`, design by intervals in `eskin.design`.
"""

from __future__ import annotations

from eskin import design, models, noise
from eskin.errors import EskinError
from eskin.interval import Answer, Interval
from eskin.messages import Block, Encoding, decode_message
from eskin.peaks import PeakEvent, Peaks, PeakStream, Verdict, find_peaks
from eskin.tube import Tube

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
    "decode_message",
    "design",
    "find_peaks",
    "models",
    "noise",
]
