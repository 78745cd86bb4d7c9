"""Contacts of a skin of 8,400 taxels: processor time of one frame, found and tracked."""

from __future__ import annotations

import time
from statistics import median
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.report import Row, at_most
from eskin.contacts import ContactStream, Skin, find_contacts

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_ROWS, _COLUMNS = 60, 140
_FRAMES: Final = 60
_THRESHOLD: Final = 1000.0
_RADIUS: Final = 200.0
_MOST_MS: Final = 5.0
_MOST_MS_OF_NOISE: Final = 20.0
"""The period of a skin at 50 Hz."""


def measure_contacts() -> list[Row]:
    """Eight fingers that slide, and noise around the threshold, which makes a thousand cores."""
    skin = Skin.grid(_ROWS, _COLUMNS, pitch=4e-3, area=12e-6)
    noise = np.random.default_rng(1).normal(_THRESHOLD, 300.0, (_FRAMES, len(skin)))
    rows = []
    for kind, frames, most in (
        ("eight touches", _touches(), _MOST_MS),
        ("noise", noise, _MOST_MS_OF_NOISE),
    ):
        name = f"contacts of {len(skin)} taxels, {kind}"
        rows.append(at_most(f"{name}, found", _found(skin, frames), "ms", _MOST_MS))
        rows.append(at_most(f"{name}, tracked", _tracked(skin, frames), "ms", most))
    return rows


def _touches() -> Floats:
    row, column = np.divmod(np.arange(_ROWS * _COLUMNS), _COLUMNS)
    frames = np.zeros((_FRAMES, _ROWS * _COLUMNS))
    for k in range(_FRAMES):
        for finger in range(8):
            x, y = 10.0 + 15.0 * finger + 0.1 * k, 30.0 + 20.0 * np.sin(0.1 * k + finger)
            frames[k] += 5000.0 * np.exp(-((column - x) ** 2 + (row - y) ** 2) / 30.0)
    return frames


def _found(skin: Skin, frames: Floats) -> float:
    return _milliseconds(frames, lambda _, lo, hi: find_contacts(lo, hi, skin, _THRESHOLD))


def _tracked(skin: Skin, frames: Floats) -> float:
    stream = ContactStream(skin, _THRESHOLD)
    return _milliseconds(frames, lambda k, lo, hi: stream.feed(lo[None], hi[None], [(k, k)]))


def _milliseconds(frames: Floats, call: Callable[[int, Floats, Floats], object]) -> float:
    """Median processor time of a frame; the first half compiles, and fills the labels."""
    taken = []
    for k, frame in enumerate(frames):
        lo, hi = frame - _RADIUS, frame + _RADIUS
        start = time.process_time()
        call(k, lo, hi)
        taken.append(time.process_time() - start)
    return median(taken[_FRAMES // 2 :]) * 1e3
