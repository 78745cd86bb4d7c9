"""Rows of a patch as they were sampled one after the other: of one frame, or of many in arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from eskin.interval import Floats

    Integers = NDArray[np.int64]


class PatchRun(NamedTuple):
    """Rows of a patch that were sampled on one grid, from one frame.

    Attributes:
        patch: Hash of the description by which it is read.
        boot: The node's start that sampled it.
        sequence: The frame's number.
        ticks: The node's clock at the first row, ns since its start.
        t: Middle of the first row's time, UTC ns; a column is later by its skew.
        error: Greatest distance of a row's time from its middle, ns.
        dt: Period, ns.
        first_row: Number of the first row in the node's schedule.
        strides: For each column ``k``: it is sampled in rows whose number is a multiple of ``2^k``;
            empty where each row has a sample of every column.
        epoch: Within an epoch shared errors are constant; 0 where samples share none.
        unshared: Columns without a shared error, ascending.
        coverage: Probability that a sample's interval encloses the truth.
        lo: Lower bounds, shape ``(rows, columns)``; infinite where unknown.
        hi: Upper bounds.
    """

    patch: bytes
    boot: int
    sequence: int
    ticks: int
    t: int
    error: int
    dt: int
    first_row: int
    strides: bytes
    epoch: int
    unshared: tuple[int, ...]
    coverage: float
    lo: Floats
    hi: Floats


class PatchMatrix(NamedTuple):
    """Many runs of one patch: an entry a run, and the rows of all.

    Attributes:
        patch: As in `PatchRun`.
        t: As in `PatchRun`; so are the next three.
        error: See there.
        dt: See there.
        first_row: See there.
        rows: Number of rows of each run.
        option: Which of ``strides`` a run has.
        strides: As in `PatchRun`, those that occur.
        lo: Lower bounds, shape ``(all rows, columns)``; infinite where unknown.
        hi: Upper bounds.
    """

    patch: bytes
    t: Integers
    error: Integers
    dt: Integers
    first_row: Integers
    rows: Integers
    option: Integers
    strides: tuple[bytes, ...]
    lo: Floats
    hi: Floats
