"""Voltage u_c of the EcFES branch (eq. 16, 27, 29): R2 in series with C at the source."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.kernels.jit import inlined, kernel, part
from eskin.kernels.outward_rounding import mul_down, mul_up
from eskin.models.icm.bracket import bracket_edge, work_space
from eskin.models.icm.clock import (
    BLOCK,
    REACH,
    ROWS,
    fill_clock,
    late_from,
    late_sample_of,
    sample_of,
)
from eskin.models.icm.curvature import edge_of, test_edge, waning
from eskin.models.icm.response import branch, phase_parts, respond
from eskin.models.icm.scaling import error_factor, scale_outward

if TYPE_CHECKING:
    from eskin.models.icm.bracket import Flags, Found, Indices
    from eskin.models.icm.clock import Sample
    from eskin.models.icm.curvature import Edge
    from eskin.models.icm.response import Branch, Phase
    from eskin.models.parameters import Floats


@kernel
def voltage_rows(
    rows: Floats, clock_of: Indices, times: Floats, lo: Floats, hi: Floats
) -> None:  # fmt: skip
    """Bounds of u_c for rows of thin frequency and phase.

    Args:
        rows: For each row bounds of amplitude, frequency, phase, R2 and C.
        clock_of: For each row the row of ``times``.
        times: Rows of times in s.
        lo: Rows of lower bounds, to be filled.
        hi: Rows of upper bounds, to be filled.
    """
    table, size = np.empty((ROWS, BLOCK)), np.empty(BLOCK)
    open_ends = np.zeros(BLOCK, dtype=np.uint8)
    work = work_space()
    for start in range(0, times.shape[1], BLOCK):
        stop = min(start + BLOCK, times.shape[1])
        for row in range(rows.shape[0]):
            given, clock = rows[row], clock_of[row]
            if row == 0 or given[2] != rows[row - 1, 2] or clock != clock_of[row - 1]:
                fill_clock(given[2], times[clock, start:stop], table)
            tau_a, tau_b = mul_down(given[6], given[8]), mul_up(given[7], given[9])
            phase = phase_parts(given[4])
            found = lo[row, start:stop], hi[row, start:stop], size
            width = _ends(given[2], tau_a, tau_b, phase, table, found, open_ends)
            span = given[2], tau_a, tau_b, 1.0
            bracket_edge(span, 0, phase, table, open_ends, found, work)
            now = times[clock, start:stop]
            scale_outward(given[0], given[1], error_factor(width), now, found)


@part
def _ends(
    frequency: float, tau_a: float, tau_b: float, phase: Phase, table: Floats, found: Found,
    open_ends: Flags,
) -> float:  # fmt: skip
    """First pass: both ends, and which samples may have an extremum between them.

    No term of the sum of sizes grows faster than τ, so one of the two sums does for both.
    """
    lo, hi, size = found
    a, b = branch(frequency, tau_a), branch(frequency, tau_b)
    edge = edge_of(a, b, tau_a, tau_b, 0, phase)
    growth = tau_b / tau_a * (1.0 + 1e-9)
    late = late_from(table, lo.size)
    for i in range(late):
        now = sample_of(table, i)
        lo[i], hi[i], size[i], open_ends[i] = _both_ends(a, b, edge, growth, phase, now)
    for i in range(late, np.uint64(lo.size)):
        now = late_sample_of(table, i)
        lo[i], hi[i], size[i], open_ends[i] = _both_ends(a, b, edge, growth, phase, now)
    return edge[0]


@inlined
def _both_ends(
    a: Branch, b: Branch, edge: Edge, growth: float, phase: Phase, now: Sample
) -> tuple[float, float, float, bool]:
    first, slope, size, s, _ = respond(a, phase, now)
    last, slope_last, _, s_last, left = respond(b, phase, now)
    reach = min(1.0, phase[2] + phase[3] * now[REACH])
    sure, _, _ = test_edge(edge, 0, slope, slope_last, s, waning(s_last, left), reach)
    return min(first, last), max(first, last), size * growth, not sure
