"""Writes frames of a small skin and its pictures, for the dashboard's tests of its skin model.

``python -m tests.unit.dashboard.skin_vectors > cloud/dashboard/tests/skin.json``
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, PatchSamples
from eskin.wire.messages import Position

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

FILE: Final = Path(__file__).parents[3] / "cloud" / "dashboard" / "tests" / "skin.json"
START: Final = 1_790_000_000_000_000_000
PERIOD: Final = 20_000_000
ROWS: Final = 4
STRETCHES: Final = 3
LAYOUT: Final = bytes(range(32))
COLUMNS: Final = (3, 2, 3)
"""Of the patches: two of pressures, on page 0 and 1, and one of temperatures, on page 1."""
PAGES: Final = (0, 1, 1)
STRIDES: Final = bytes([0, 1, 3])
"""Of the last patch: its columns are sampled in each row, each second and each eighth:
the second stretch has no sample of the last one."""


def document() -> dict[str, Any]:
    """A layout, its frames in the order of time, and pictures computed from the same bounds."""
    bounds = [_bounds(patch) for patch in range(len(COLUMNS))]
    frames = [
        _frame(bounds, stretch, page).encode().hex()
        for stretch in range(STRETCHES)
        for page in (0, 1)
    ]
    return {
        "layout": _layout(),
        "frames": frames,
        "pictures": {
            "pressure": [_picture(bounds, (0, 1), row) for row in range(STRETCHES * ROWS)],
            "temperature": [_picture(bounds, (2,), row) for row in range(STRETCHES * ROWS)],
        },
        "start": str(START),
        "period": PERIOD,
    }


def _bounds(patch: int) -> tuple[Floats, Floats]:
    row, column = np.indices((STRETCHES * ROWS, COLUMNS[patch]))
    lo = 1000.0 * patch + 10.0 * row + column
    hi = lo + 2.0 + column
    unknown = (row * 5 + column) % 7 == 3
    above = (row * 3 + column) % 11 == 5
    lo, hi = np.where(unknown, -np.inf, lo), np.where(unknown | above, np.inf, hi)
    if patch == 2:
        unsampled = row % 2 ** np.array(list(STRIDES))[column] != 0
        lo, hi = np.where(unsampled, -np.inf, lo), np.where(unsampled, np.inf, hi)
    return np.asarray(lo, np.float64), np.asarray(hi, np.float64)


def _frame(bounds: list[tuple[Floats, Floats]], stretch: int, page: int) -> Frame:
    rows = slice(stretch * ROWS, (stretch + 1) * ROWS)
    grid = Grid(0, PERIOD, stretch * ROWS, ROWS, 1.0)
    samples = tuple(
        PatchSamples.pack(
            Interval(bounds[patch][0][rows], bounds[patch][1][rows]),
            1.0,
            patch=patch,
            grid=0,
            first_row=stretch * ROWS,
            strides=STRIDES if patch == 2 else b"",
        )
        for patch in range(len(COLUMNS))
        if PAGES[patch] == page
    )
    begin = START + stretch * ROWS * PERIOD
    number = Position(1, 2 * stretch + page)
    ticks = stretch * ROWS * PERIOD
    return Frame(number, LAYOUT, page, ticks, (begin, begin + 1000), (grid,), samples)


def _picture(
    bounds: list[tuple[Floats, Floats]], patches: tuple[int, ...], row: int
) -> dict[str, list[float | None]]:
    """Bounds of each taxel at a row: the latest sample of each column; null is unbounded."""
    lo: list[float | None] = []
    hi: list[float | None] = []
    for patch in patches:
        for column in range(COLUMNS[patch]):
            every = 2 ** STRIDES[column] if patch == 2 else 1
            sampled = row - row % every
            for side, found in zip(bounds[patch], (lo, hi), strict=True):
                value = float(side[sampled, column])
                found.append(value if np.isfinite(value) else None)
    return {"lo": lo, "hi": hi}


def _layout() -> dict[str, Any]:
    patches = []
    for number, columns in enumerate(COLUMNS):
        x = [1e-3 * column for column in range(columns)]
        pressed = number < 2
        patches.append(
            {
                "patch": f"p{number}",
                "hash": f"{number:064x}",
                "quantity": "pressure" if pressed else "temperature",
                "unit": "Pa" if pressed else "Cel",
                "taxels": [f"t{number}{column}" for column in range(columns)],
                "positions": [x, [1e-3 * number] * columns],
                "neighbours": [],
                "least_width": 1.0,
                "threshold": 1005.0 if pressed else None,
                "cell_area": 1e-6 if pressed else None,
                "page": PAGES[number],
                "node": "hand",
            }
        )
    empty: dict[str, list[object]] = {"seams": [], "controllers": [], "outline": []}
    return {"layout": LAYOUT.hex(), "patches": patches} | empty


if __name__ == "__main__":
    json.dump(document(), sys.stdout, indent=1)
    sys.stdout.write("\n")
