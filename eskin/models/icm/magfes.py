"""Current i1 of the MagFES branch (eq. 15, 26, 28): R1 in series with L at the source.

``i1 = (Vm/R1)·h(t; L/R1)`` has degree -1 in (R1, L): where both slopes vanish inside the box it is
zero, and then on the whole ray through that point. So its extremes lie on the box's four edges. In
units of ``Vm/R1_max``: ``h`` itself on the edge of greatest R1, ``h`` times the ratio of the
resistances on that of least R1, and ``(τ/τ_ref)·h`` on the edges of constant L.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import inlined, kernel, part
from eskin.kernels.outward_rounding import div_down, div_up
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
from eskin.models.icm.response import UNDERFLOW_SIZE, branch, phase_parts, respond
from eskin.models.icm.scaling import error_factor, scale_outward

if TYPE_CHECKING:
    from typing import TypeAlias

    from eskin.models.icm.bracket import Flags, Found, Indices, Work
    from eskin.models.icm.clock import Sample
    from eskin.models.icm.curvature import Edge
    from eskin.models.icm.response import Branch, Phase
    from eskin.models.parameters import Floats

    Corners: TypeAlias = tuple[float, float, float, float]
    Box: TypeAlias = tuple[
        tuple[Branch, Branch, Branch, Branch], tuple[Edge, Edge, Edge, Edge], Corners, Phase
    ]

_TWINS: Final = 8 * 2.0**-53
"""Time constants that are this close, relatively, count as one where the box is `_WIDE`."""
_TWIN_ERROR: Final = 2.5
"""Error with twins, over that without: an edge's value moves by at most ``8 u·4 T``."""
_WIDE: Final = 1e-6


@kernel
def current_rows(
    rows: Floats, clock_of: Indices, times: Floats, lo: Floats, hi: Floats
) -> None:  # fmt: skip
    """Bounds of i1 for rows of thin frequency and phase.

    Args:
        rows: For each row bounds of amplitude, frequency, phase, R1 and L.
        clock_of: For each row the row of ``times``.
        times: Rows of times in s.
        lo: Rows of lower bounds, to be filled.
        hi: Rows of upper bounds, to be filled.
    """
    table, size = np.empty((ROWS, BLOCK)), np.empty(BLOCK)
    open_edges = np.zeros((4, BLOCK), dtype=np.uint8)
    work = work_space()
    for start in range(0, times.shape[1], BLOCK):
        stop = min(start + BLOCK, times.shape[1])
        for row in range(rows.shape[0]):
            given, clock = rows[row], clock_of[row]
            if row == 0 or given[2] != rows[row - 1, 2] or clock != clock_of[row - 1]:
                fill_clock(given[2], times[clock, start:stop], table)
            f, phase, r_a, r_b = given[2], phase_parts(given[4]), given[6], given[7]
            taus, twin = _time_constants(r_a, r_b, given[8], given[9])
            ratio = r_b / r_a
            found = lo[row, start:stop], hi[row, start:stop], size
            width = _corners(f, taus, twin, ratio, phase, table, found, open_edges)
            _open(f, taus, ratio, phase, table, open_edges, (found, work))
            inf, sup = div_down(given[0], r_b), div_up(given[1], r_b)
            factor = error_factor(width) * (_TWIN_ERROR if twin else 1.0)
            scale_outward(inf, sup, factor, times[clock, start:stop], found)


@part
def _time_constants(r_a: float, r_b: float, l_a: float, l_b: float) -> tuple[Corners, bool]:
    """L/R1 at the corners; and whether the middle two count as one, as with equal tolerances."""
    taus = l_a / r_b, l_b / r_b, l_a / r_a, l_b / r_a
    wide = taus[3] - taus[0] > _WIDE * taus[0]
    twin = wide & (abs(taus[2] - taus[1]) <= _TWINS * taus[1])
    return (taus[0], taus[1], taus[1] if twin else taus[2], taus[3]), twin


@part
def _open(
    f: float,
    taus: Corners,
    ratio: float,
    phase: Phase,
    table: Floats,
    open_edges: Flags,
    place: tuple[Found, Work],
) -> None:
    """Second pass: edge by edge, as corners 0 to 3 stand in `_corners`."""
    found, work = place
    bracket_edge((f, taus[0], taus[1], 1.0), 0, phase, table, open_edges[0], found, work)
    bracket_edge((f, taus[2], taus[3], ratio), 0, phase, table, open_edges[1], found, work)
    bracket_edge((f, taus[0], taus[2], 1.0), 1, phase, table, open_edges[2], found, work)
    bracket_edge((f, taus[1], taus[3], 1.0), 1, phase, table, open_edges[3], found, work)


@part
def _corners(
    frequency: float, taus: Corners, twin: bool, ratio: float, phase: Phase, table: Floats,  # noqa: FBT001
    found: Found, open_edges: Flags,
) -> float:  # fmt: skip
    """First pass: the corners, and which edges may have an extremum between them.

    No term of the sum of sizes grows faster than τ, so one sum does for all corners.
    """
    a, b = branch(frequency, taus[0]), branch(frequency, taus[1])
    c, d = branch(frequency, taus[2]), branch(frequency, taus[3])
    bottom = edge_of(a, b, taus[0], taus[1], 0, phase)
    top = edge_of(c, d, taus[2], taus[3], 0, phase)
    left = edge_of(a, c, taus[0], taus[2], 1, phase)
    right = edge_of(b, d, taus[1], taus[3], 1, phase)
    corners, edges = (a, b, c, d), (bottom, top, left, right)
    growth = ratio * (taus[3] / taus[0]) * (1.0 + 1e-9)
    scales = ratio, taus[2] / taus[0], taus[3] / taus[1], growth
    box = corners, edges, scales, phase
    if twin:  # a constant for each, so that the compiler drops the fourth response
        _all_samples(box, True, table, found, open_edges)  # noqa: FBT003
    else:
        _all_samples(box, False, table, found, open_edges)  # noqa: FBT003
    return max(bottom[0], top[0]) + max(left[0], right[0])


@inlined
def _all_samples(
    box: Box,
    twin: bool,  # noqa: FBT001 - compiled code knows no keywords
    table: Floats,
    found: Found,
    open_edges: Flags,
) -> None:
    lo, hi, size = found
    late = late_from(table, lo.size)
    for i in range(late):
        lo[i], hi[i], size[i], flags = _all_corners(box, twin, sample_of(table, i))
        open_edges[0, i], open_edges[1, i], open_edges[2, i], open_edges[3, i] = flags
    for i in range(late, np.uint64(lo.size)):
        lo[i], hi[i], size[i], flags = _all_corners(box, twin, late_sample_of(table, i))
        open_edges[0, i], open_edges[1, i], open_edges[2, i], open_edges[3, i] = flags


@inlined
def _all_corners(
    box: Box,
    twin: bool,  # noqa: FBT001 - compiled code knows no keywords
    now: Sample,
) -> tuple[float, float, float, tuple[bool, bool, bool, bool]]:
    corners, edges, scales, phase = box
    h_a, d_a, size, s_a, _ = respond(corners[0], phase, now)
    h_b, d_b, _, s_b, _ = respond(corners[1], phase, now)
    h_c, d_c, s_c = h_b, d_b, s_b
    if not twin:
        h_c, d_c, _, s_c, _ = respond(corners[2], phase, now)
    h_d, d_d, _, s_d, e_d = respond(corners[3], phase, now)
    ratio, grown_c, grown_d, growth = scales
    reach = min(1.0, phase[2] + phase[3] * now[REACH])
    wane = waning(s_d, e_d)
    p_a, p_b, p_c, p_d = h_a + d_a, h_b + d_b, grown_c * (h_c + d_c), grown_d * (h_d + d_d)
    sure_0, over_0, _ = test_edge(edges[0], 0, d_a, d_b, s_a, wane, reach)
    sure_1, over_1, _ = test_edge(edges[1], 0, d_c, d_d, s_c, wane, reach)
    sure_2, over_2, _ = test_edge(edges[2], 1, p_a, p_c, s_a, wane, reach)
    sure_3, over_3, _ = test_edge(edges[3], 1, p_b, p_d, s_b, wane, reach)
    # In units of Vm/R1_max; the right edge's own unit is the weight of its first corner, 1.
    h_c, h_d, over_1 = ratio * h_c, ratio * h_d, ratio * over_1
    least, most = (
        min(min(h_a, h_b), min(h_c, h_d)),
        max(max(h_a, h_b), max(h_c, h_d)),
    )
    flags = (
        not (sure_0 | _within(h_a, h_b, over_0, least, most)),
        not (sure_1 | _within(h_c, h_d, over_1, least, most)),
        not (sure_2 | _within(h_a, h_c, over_2, least, most)),
        not (sure_3 | _within(h_b, h_d, over_3, least, most)),
    )
    return least, most, (size + UNDERFLOW_SIZE) * growth, flags


@part
def _within(first: float, last: float, over: float, least: float, most: float) -> bool:
    """Whether an edge cannot leave what the corners span."""
    return (max(first, last) + over <= most) & (min(first, last) - over >= least)
