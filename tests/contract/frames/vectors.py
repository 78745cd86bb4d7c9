"""Writes frames and what they hold, for decoders in other languages.

``python -m tests.contract.frames.vectors > cloud/dashboard/tests/frames.json``
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np

from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, PatchSamples
from eskin.wire.messages import Position
from tests.unit.eskin.wire.frames.examples import FRAME

FILE: Final = Path(__file__).parents[3] / "cloud" / "dashboard" / "tests" / "frames.json"
INF: Final = np.inf


def frames() -> list[Frame]:
    """Frames of all that a decoder must know."""
    return [
        FRAME,
        _frame(Interval(np.zeros((1, 1))), 1.0),
        _frame(Interval.entire((3, 2)), 1.0),
        _frame(_waves(12, 64), 50.0),
        _frame(_waves(3, 14), 1e-300),
        _frame(_waves(9, 65 - 1), 5e-3, first_row=2**53 - 1, strides=bytes(range(17)) + bytes(47)),
        _frame(_worst(), 64.0),
        _frame(Interval([[-(2.0**950), 5e-324]], [[2.0**950, 1.0]]), 5e-324),
        _frame(Interval([[5e-324, -5e-324]], [[1e-300, 5e-324]]), 5e-324),
    ]


def document() -> list[dict[str, Any]]:
    """Each frame and each patch's bounds, in hexadecimal: float64, little endian."""
    return [
        {
            "frame": frame.encode().hex(),
            "patches": [
                {
                    "lo": values.inf.astype("<f8").tobytes().hex(),
                    "hi": values.sup.astype("<f8").tobytes().hex(),
                }
                for values in frame.values
            ],
        }
        for frame in frames()
    ]


def _frame(
    values: Interval, least_width: float, *, first_row: int = 0, strides: bytes = b""
) -> Frame:
    grid = Grid(0, 1_000_000, first_row, values.shape[0], 1.0)
    samples = PatchSamples.pack(
        values, least_width, patch=0, grid=0, first_row=first_row, strides=strides
    )
    return Frame(Position(1, 2), bytes(range(32)), 0, 5, (-7, 2**62), (grid,), (samples,))


def _waves(rows: int, columns: int) -> Interval:
    """A touch that moves; a column in ten is clipped above, one unknown now and then."""
    row, column = np.indices((rows, columns))
    lo = 5000.0 * np.exp(-((column - 3.0 * row) ** 2) / 50.0) - 100.0
    hi = np.where(column % 10 == 3, INF, lo + 150.0 + column)
    unknown = (row * columns + column) % 17 == 5
    below = (row + column) % 23 == 7
    return Interval(np.where(unknown | below, -INF, lo), np.where(unknown, INF, hi))


def _worst() -> Interval:
    """Differences of 24 bits."""
    chess = np.indices((5, 64)).sum(axis=0) % 2
    lo = np.where(chess, 0.0, 2.0**23 + 5)
    return Interval(lo, lo + np.where(chess, 2.0**23 + 2, 0.0))


if __name__ == "__main__":
    json.dump(document(), sys.stdout, indent=1)
    sys.stdout.write("\n")
