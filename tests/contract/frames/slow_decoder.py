"""A decoder of frames written from the text of ``docs/eskin.cddl``, with no part of eskin.

Slow, exact (fractions), and only for frames that are valid.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import Any

import cbor2

Bound = Fraction | None
"""None is unbounded."""
Matrix = list[list[tuple[Bound, Bound] | None]]
"""Rows of samples; None where a cell holds none."""


def decode_frame(data: bytes) -> dict[int, Matrix]:
    """The samples of each patch, by its number."""
    frame = cbor2.loads(data)
    return {samples[0]: decode_patch(samples, frame[8][samples[1]]) for samples in frame[9]}


def decode_patch(samples: list[Any], grid: list[Any]) -> Matrix:
    """The samples of one patch."""
    _, _, _, columns, exponent, offset, codes = samples[:7]
    options = samples[7] if len(samples) == 8 else {}
    _, _, first_row, rows, _ = grid
    strides = options.get(1, bytes(columns))
    sampled = [
        (r, c)
        for r in range(rows)
        for c in range(columns)
        if (first_row + r) % 2 ** strides[c] == 0
    ]
    columns_of = {c: [cell for cell in sampled if cell[1] == c] for c in range(columns)}
    firsts = sorted(cells[0] for cells in columns_of.values() if cells)
    before = {b: a for cells in columns_of.values() for a, b in pairwise(cells)}
    others = [cell for cell in sampled if cell in before]
    bits = "".join(f"{byte:08b}"[::-1] for byte in codes)  # lowest bit first
    place = 0
    matrices: list[dict[tuple[int, int], int]] = []
    for _ in range(2):
        matrix: dict[tuple[int, int], int] = {}
        differences, place = read_run(bits, place, len(firsts))
        last = 0
        for cell, difference in zip(firsts, differences, strict=True):
            matrix[cell] = last = (last + difference) % 2**24
        differences, place = read_run(bits, place, len(others))
        for cell, difference in zip(others, differences, strict=True):
            matrix[cell] = (matrix[before[cell]] + difference) % 2**24
        matrices.append(matrix)
    assert place == len(bits)
    result: Matrix = [[None] * columns for _ in range(rows)]
    for row, column in sampled:
        base, kind = (matrix[row, column] for matrix in matrices)
        quantum = Fraction(2) ** exponent
        low, high = (offset + base) * quantum, (offset + base + kind - 3) * quantum
        result[row][column] = {0: (None, None), 1: (None, low), 2: (low, None)}.get(
            kind, (low, high)
        )
    return result


def read_run(bits: str, place: int, count: int) -> tuple[list[int], int]:
    """Differences, and where they end."""
    found: list[int] = []
    while len(found) < count:
        width, place = number(bits[place : place + 8]), place + 8
        size = min(64, count - len(found))
        for k in range(size):
            folded = number(bits[place + k * width : place + (k + 1) * width])
            found.append(folded // 2 if folded % 2 == 0 else -(folded + 1) // 2)
        place += -(-size * width // 8) * 8
    return found, place


def number(bits: str) -> int:
    """A number from its bits, lowest first."""
    return int(bits[::-1], 2) if bits else 0
