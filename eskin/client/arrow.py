"""Tubes from the rows of an export."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from eskin.interval import Interval
from eskin.tube import Tube

if TYPE_CHECKING:
    from collections.abc import Iterator


def read_tubes(table: Any) -> Iterator[Tube]:
    """A tube for each block of one channel.

    Args:
        table: An export's Arrow table; see docs/rest.md.
    """
    if table.num_rows == 0:
        return
    boot, sequence, dt, earliest, latest = (
        table[name].cast(pa.int64()).to_numpy()
        for name in ("boot", "sequence", "dt", "earliest", "latest")
    )
    # A missing sample is unbounded on both sides (decision 12).
    lo = table["lo"].fill_null(-np.inf).to_numpy()
    hi = table["hi"].fill_null(np.inf).to_numpy()
    coverage = table["coverage"].to_numpy()
    begins = np.flatnonzero((np.diff(boot) != 0) | (np.diff(sequence) != 0)) + 1
    edges = [0, *begins.tolist(), table.num_rows]
    for first, end in pairwise(edges):
        yield Tube(
            (int(earliest[first]), int(latest[first])),
            int(dt[first]),
            Interval(lo[first:end], hi[first:end]),
            table["unit"][first].as_py(),
            float(coverage[first]),
        )
