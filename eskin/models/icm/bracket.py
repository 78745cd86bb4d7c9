"""Second pass, for all samples that need it at once: brackets an extremum inside an edge.

The edge is cut into pieces of at most a ninth in ``ln τ``. Where a piece's slope keeps its sign,
its ends are exact. Where one piece is left, and it bends to one side only, its extremum is found
from a parabola through the slopes and the mean slope; with slope ``d`` there and at least bend
``m``, the true extremum lies at most ``d²/2m`` beyond. The few samples with more than that go to
`eskin.models.icm.edge`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import part
from eskin.models.icm.clock import REACH, sample_of
from eskin.models.icm.curvature import edge_of, test_edge, waning
from eskin.models.icm.edge import FINE, STACK, edge_range, parabola_root
from eskin.models.icm.response import ROUNDING, UNDERFLOW, branch, respond

if TYPE_CHECKING:
    from typing import TypeAlias

    from numpy.typing import NDArray

    from eskin.models.icm.clock import Sample
    from eskin.models.icm.edge import Span
    from eskin.models.icm.response import Branch, Phase
    from eskin.models.parameters import Floats

    Flags: TypeAlias = NDArray[np.uint8]
    Indices: TypeAlias = NDArray[np.int64]
    Found: TypeAlias = tuple[Floats, Floats, Floats]
    Work: TypeAlias = tuple[Floats, Indices, Floats]
    Ends: TypeAlias = tuple[float, Branch, float, Branch]

_PIECE: Final = 0.11  # of ln τ: a piece's bend is mostly greater than what it may change by
_MOST_PIECES: Final = 24
CHUNK: Final = 256
"""Samples at a time. A constant, so that the compiler sees that rows of work do not overlap."""
# Where rows of work start, after six of the clock.
_OPEN: Final = 6 * CHUNK
_A: Final = 7 * CHUNK
_FA: Final = 8 * CHUNK
_DA: Final = 9 * CHUNK
_WIDTH: Final = 10 * CHUNK
_FB: Final = 11 * CHUNK
_DB: Final = 12 * CHUNK
_LEAST: Final = 13 * CHUNK
_F: Final = 14 * CHUNK
_D: Final = 15 * CHUNK
_S: Final = 16 * CHUNK
_LO: Final = 17 * CHUNK
_HI: Final = 18 * CHUNK
_SIZE: Final = 19 * CHUNK
_ROOM: Final = 20 * CHUNK


@part
def bracket_edge(
    span: Span, power: int, phase: Phase, table: Floats, flags: Flags, found: Found, work: Work
) -> None:
    """Widen what was found to the range of ``scale·(τ/τ_a)^p·h`` at all flagged samples.

    Args:
        span: The edge.
        power: p, a literal: the compiler makes one loop for each.
        phase: Of `phase_parts`.
        table: The clock's table.
        flags: Which samples; its length is a multiple of 8, those beyond the last are 0.
        found: Least and greatest values that are reached, and the sums of sizes behind them.
        work: Of `work_space`.
    """
    lo, hi, size = found
    room, chosen, stack = work
    pieces = _pieces(span)
    words = flags[: (lo.size + 7) // 8 * 8].view(np.uint64)
    word, m = 0, 0
    while word < words.size:
        if words[word] != 0:
            for i in range(8 * word, min(8 * word + 8, lo.size)):
                chosen[m] = i
                m += flags[i]
        word += 1
        if (m > CHUNK - 8) | ((word == words.size) & (m > 0)):
            full = (m + 7) // 8 * 8  # what stands beyond a multiple of 8 is no vector's work
            chosen[m:full] = chosen[m - 1]
            _gather(table, found, chosen, full, room)
            if pieces > 0:
                _cut(span, power, phase, room, full, pieces)
                _close(span, power, phase, room, full)
            for j in range(m):
                i = chosen[j]
                known = room[_LO + j], room[_HI + j], room[_SIZE + j]
                if room[_OPEN + j] > 0.0:
                    known = edge_range(span, power, phase, sample_of(table, i), known, stack)
                lo[i], hi[i], size[i] = known
            m = 0


@part
def work_space() -> Work:
    """Numbers, indices and a stack for `bracket_edge`."""
    return np.empty(_ROOM), np.empty(CHUNK, np.int64), np.empty(STACK)


@part
def _gather(table: Floats, found: Found, chosen: Indices, m: int, room: Floats) -> None:
    lo, hi, size = found
    for j in range(m):
        i = chosen[j]
        for k in range(6):
            room[k * CHUNK + j] = table[k, i]
        room[_LO + j], room[_HI + j], room[_SIZE + j] = lo[i], hi[i], size[i]
        room[_OPEN + j] = 1.0


@part
def _sample(room: Floats, j: int) -> Sample:
    early = room[5 * CHUNK + j] != 0.0
    return (
        room[j], room[CHUNK + j], room[2 * CHUNK + j], room[3 * CHUNK + j], room[4 * CHUNK + j],
        early,
    )  # fmt: skip


@part
def _pieces(span: Span) -> int:
    """How many pieces to cut; 0 where there would be too many."""
    count = math.log(span[2] / span[1]) / _PIECE
    return int(count) + 1 if count < _MOST_PIECES - 1 else 0


@part
def _cut(span: Span, power: int, phase: Phase, room: Floats, m: int, pieces: int) -> None:
    """Test piece after piece; note the one that stays open."""
    frequency, tau_a, tau_b, scale = span
    tau, of = tau_a, branch(frequency, tau_a)
    for j in range(m):
        h, slope, _, s, _ = respond(of, phase, _sample(room, j))
        room[_F + j] = scale * h
        room[_D + j] = scale * (h + slope if power == 1 else slope)
        room[_S + j] = s
        room[_OPEN + j] = 0.0
    step = math.exp(math.log(tau_b / tau_a) / pieces)
    for piece in range(pieces):
        tau_next = tau_b if piece == pieces - 1 else min(tau * step, tau_b)
        of_next = branch(frequency, tau_next)
        _piece(span, power, phase, (tau, of, tau_next, of_next), room, m)
        tau, of = tau_next, of_next


@part
def _piece(span: Span, power: int, phase: Phase, ends: Ends, room: Floats, m: int) -> None:
    """Go on to the end of a piece: test it, and keep its data where it stays open."""
    _, tau_a, _, scale = span
    tau, of, tau_next, of_next = ends
    edge = edge_of(of, of_next, tau, tau_next, power, phase)
    weight, weight_next = scale, scale
    if power == 1:
        weight, weight_next = scale * (tau / tau_a), scale * (tau_next / tau_a)
    inverse, width = 1.0 / weight, edge[0]
    inverse_width = 1.0 / width
    for j in range(m):
        now = _sample(room, j)
        h, slope, size, s_next, left = respond(of_next, phase, now)
        f = weight_next * h
        d = weight_next * (h + slope if power == 1 else slope)
        before, s = room[_D + j], room[_S + j]
        reach = min(1.0, phase[2] + phase[3] * now[REACH])
        wane = waning(s_next, left)
        sure, over, k = test_edge(edge, power, before * inverse, d * inverse, s, wane, reach)
        size = max(room[_SIZE + j], weight_next * size)
        least = (abs(d - before) - 6.0 * ROUNDING * size - weight * k) * inverse_width
        f_before = room[_F + j]
        lo, hi = min(room[_LO + j], f), max(room[_HI + j], f)
        over *= weight
        within = (max(f, f_before) + over <= hi) & (min(f, f_before) - over >= lo)
        sure = sure | within | (((before >= 0.0) == (d >= 0.0)) & (least > 0.0))
        room[_OPEN + j] += 0.0 if sure else (1.0 if least > 0.0 else 2.0)
        room[_A + j] = room[_A + j] if sure else tau
        room[_FA + j] = room[_FA + j] if sure else room[_F + j]
        room[_DA + j] = room[_DA + j] if sure else before
        room[_FB + j] = room[_FB + j] if sure else f
        room[_DB + j] = room[_DB + j] if sure else d
        room[_WIDTH + j] = room[_WIDTH + j] if sure else width
        room[_LEAST + j] = room[_LEAST + j] if sure else least
        room[_F + j], room[_D + j], room[_S + j] = f, d, s_next
        room[_LO + j], room[_HI + j], room[_SIZE + j] = lo, hi, size


@part
def _close(span: Span, power: int, phase: Phase, room: Floats, m: int) -> None:
    """Bracket the extremum where one piece is open and bends to one side."""
    frequency, tau_a, _, scale = span
    for j in range(m):
        is_open = room[_OPEN + j] == 1.0
        f_a, d_a, width = room[_FA + j], room[_DA + j], room[_WIDTH + j]
        f_b, d_b, least = room[_FB + j], room[_DB + j], room[_LEAST + j]
        gap = width * parabola_root(d_a, d_b, (f_b - f_a) / width)
        grown = 1.0 + gap * (1.0 + gap * (0.5 + gap * 0.16666667))
        tau = room[_A + j] * grown if is_open else tau_a
        h, slope, size, _, _ = respond(branch(frequency, tau), phase, _sample(room, j))
        weight = scale * (tau / tau_a) if power == 1 else scale
        f, d = weight * h, weight * (h + slope if power == 1 else slope)
        size = max(room[_SIZE + j], weight * size)
        lo, hi = min(room[_LO + j], f), max(room[_HI + j], f)
        slope_size = abs(d) + 3.0 * ROUNDING * size + UNDERFLOW
        beyond = slope_size * slope_size / (2.0 * least)
        done = is_open & (beyond <= FINE * (hi - lo) + 0.25 * ROUNDING * size)
        rises = d_b > d_a
        room[_LO + j] = min(lo, f - beyond) if done & rises else room[_LO + j]
        room[_HI + j] = max(hi, f + beyond) if done & (not rises) else room[_HI + j]
        room[_SIZE + j] = size if done else room[_SIZE + j]
        room[_OPEN + j] = 0.0 if done else room[_OPEN + j]
