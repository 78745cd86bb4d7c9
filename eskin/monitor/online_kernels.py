"""The compiled part of `eskin.monitor.online`: samples in, final verdicts out.

A set of ticks is a list of runs ``[first, last]``, ascending, with a hole between two (see
`eskin.monitor.runs`, which states the same operators over whole recordings). All lists of an
evaluation lie one after the other in two arrays, ``firsts`` and ``lasts``; a function that makes a
list writes it from ``top`` on and returns its end.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.monitor.formula import MAX_BOUND
from eskin.monitor.program import Op
from eskin.monitor.runs import END
from eskin.monitor.signal import MAX_INSTANT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Ints = NDArray[np.int64]
    Codes = NDArray[np.int8]

CERTAIN: Final = 1
POSSIBLE: Final = 2
"""Bits of an atom's code for a sample: true for all of its values, and for some."""
NO_UNTIL: Final = -END
"""Of a channel for which no hold or gap with an end was stated."""
FULL: Final = -1
"""The lists have no room left: repeat with larger arrays."""
_FIRST: Final = -END
_LEAST_ROOM: Final = 16


class Side(IntEnum):
    """How an atom's code is found."""

    AT_LEAST = 0
    """The channel is compared with a threshold: the value is not less."""
    AT_MOST = 1
    """The value is not greater."""
    CODED = 2
    """The caller gives the codes of each sample."""
    LISTED = 3
    """Several channels: the caller gives the ticks."""


_AT_THRESHOLD: Final = int(Side.AT_LEAST)
_AT_MOST: Final = int(Side.AT_MOST)
_LISTED: Final = int(Side.LISTED)
_ATOM: Final = int(Op.ATOM)
_NOT: Final = int(Op.NOT)
_AT_LEAST: Final = int(Op.AT_LEAST)
_FEWER: Final = int(Op.FEWER)
_IMPLIES: Final = int(Op.IMPLIES)
_ALWAYS: Final = int(Op.ALWAYS)
_EVENTUALLY: Final = int(Op.EVENTUALLY)
_HISTORICALLY: Final = int(Op.HISTORICALLY)
_ONCE: Final = int(Op.ONCE)
_UNTIL: Final = int(Op.UNTIL)
_SINCE: Final = int(Op.SINCE)
_RISE: Final = int(Op.RISE)


@kernel
def accept(  # noqa: C901, PLR0913, PLR0917 - the columns of samples, twice
    earliest: Ints,
    latest: Ints,
    lo: Any,
    hi: Any,
    periods: Ints,
    gaps: Any,
    epochs: Ints,
    times: Ints,
    bounds: Any,
    gap: Any,
    codes: Codes,
    sides: Ints,
    thresholds: Any,
    spans: Ints,
    channel: int,
) -> tuple[int, int]:
    """Append samples to those of a channel, with the codes of its atoms.

    The row has room for what is kept and what is new; what is kept is moved to its beginning if
    there is no room behind it.

    Args:
        earliest: Of the new samples.
        latest: Of the new samples.
        lo: Of the new samples; one that is unbounded on both sides is a missing one.
        hi: Of the new samples.
        periods: Of each, or of all.
        gaps: Whether a gap follows each; empty where none does.
        epochs: Of each, or of all.
        times: Earliest, latest, period and epoch of the samples that are kept, a row a channel.
        bounds: Their lo and hi.
        gap: Whether a gap follows.
        codes: Codes of each atom, a row each.
        sides: `Side` of each atom, a row a channel; those of other channels are `Side.LISTED`.
        thresholds: Of each atom.
        spans: Of each channel, the first sample that is kept, the end, and `NO_UNTIL` or until when
            the last one is held.
        channel: Which row.

    Returns:
        The place of the first new sample, and which sample is in error, or -1.
    """
    begin, end, until = spans[channel, 0], spans[channel, 1], spans[channel, 2]
    if end + earliest.size > gap.shape[1]:
        for k in range(begin, end):
            times[:, channel, k - begin] = times[:, channel, k]
            bounds[:, channel, k - begin] = bounds[:, channel, k]
            gap[channel, k - begin] = gap[channel, k]
            for atom in range(thresholds.size):
                if sides[channel, atom] != _LISTED:
                    codes[atom, k - begin] = codes[atom, k]
        begin, end = 0, end - begin
        spans[channel, 0] = 0
    added, wrong = end, -1
    for k in range(earliest.size):
        low, high = lo[k], hi[k]
        if low == -np.inf and high == np.inf:
            if end > begin:
                gap[channel, end - 1] = True
            continue
        after = times[0, channel, end - 1] if end > begin else _FIRST
        first = max(earliest[k], after, until)
        period = periods[k if periods.size > 1 else 0]
        in_order = -MAX_INSTANT <= first <= latest[k] <= MAX_INSTANT and after < latest[k]
        if not (in_order and low <= high and 0 < period <= MAX_BOUND):
            wrong = k
            break
        times[0, channel, end], times[1, channel, end] = first, latest[k]
        times[2, channel, end] = period
        times[3, channel, end] = epochs[k if epochs.size > 1 else 0]
        bounds[0, channel, end], bounds[1, channel, end] = low, high
        gap[channel, end] = gaps.size > 0 and gaps[k]
        for atom in range(thresholds.size):
            if sides[channel, atom] == _AT_THRESHOLD:
                threshold = thresholds[atom]
                codes[atom, end] = (low >= threshold) + 2 * (high >= threshold)
            elif sides[channel, atom] == _AT_MOST:
                threshold = thresholds[atom]
                codes[atom, end] = (high <= threshold) + 2 * (low <= threshold)
        end += 1
        until = NO_UNTIL
    spans[channel, 1], spans[channel, 2] = end, until
    return added, wrong


@part
def _add(firsts: Ints, lasts: Ints, begin: int, top: int, first: int, last: int) -> int:
    """Append a run to the list that begins at ``begin``; it begins not before the last one."""
    if first > last:
        return top
    if top > begin and first - 1 <= lasts[top - 1]:
        lasts[top - 1] = max(lasts[top - 1], last)
        return top
    firsts[top], lasts[top] = first, last
    return top + 1


@part
def _put(firsts: Ints, lasts: Ints, begin: int, top: int, first: int, last: int) -> int:
    """Add a run, wherever it begins, to the list that begins at ``begin``."""
    if first > last:
        return top
    at = top
    while at > begin and lasts[at - 1] >= first - 1:
        at -= 1
    behind = at
    while behind < top and firsts[behind] - 1 <= last:
        first, last = min(first, firsts[behind]), max(last, lasts[behind])
        behind += 1
    joined = behind - at
    if joined == 0:
        for k in range(top, at, -1):
            firsts[k], lasts[k] = firsts[k - 1], lasts[k - 1]
    elif joined > 1:
        for k in range(behind, top):
            firsts[k - joined + 1], lasts[k - joined + 1] = firsts[k], lasts[k]
    firsts[at], lasts[at] = first, last
    return top - joined + 1


@part
def _shifted(tick: int, by: int) -> int:
    return tick if abs(tick) == END else tick + by


@part
def _complement(firsts: Ints, lasts: Ints, begin: int, count: int, top: int) -> int:
    start, new = _FIRST, top
    for k in range(begin, begin + count):
        top = _add(firsts, lasts, new, top, start, firsts[k] - 1)
        if lasts[k] == END:
            return top
        start = lasts[k] + 1
    return _add(firsts, lasts, new, top, start, END)


@part
def _in_many(  # noqa: C901, PLR0912 - one sweep
    firsts: Ints,
    lasts: Ints,
    lists: Ints,
    number: int,
    at: Ints,
    inside: Any,
    top: int,
) -> int:
    """Ticks that are in so many of the lists (begin and count in each row)."""
    new = top
    if number <= 0:
        return _add(firsts, lasts, new, top, _FIRST, END)
    size = lists.shape[0]
    if number > size:
        return top
    for k in range(size):
        at[k], inside[k] = lists[k, 0], False
    count, start = 0, _FIRST
    while True:
        tick, some = END, False
        for k in range(size):
            if inside[k]:
                if lasts[at[k]] != END:
                    tick, some = min(tick, lasts[at[k]] + 1), True
            elif at[k] < lists[k, 0] + lists[k, 1]:
                tick, some = min(tick, firsts[at[k]]), True
        if not some:
            break
        before = count
        for k in range(size):
            if inside[k] and lasts[at[k]] != END and lasts[at[k]] + 1 == tick:
                inside[k] = False
                at[k] += 1
                count -= 1
            elif not inside[k] and at[k] < lists[k, 0] + lists[k, 1] and firsts[at[k]] == tick:
                inside[k] = True
                count += 1
        if before < number <= count:
            start = tick
        elif count < number <= before:
            top = _add(firsts, lasts, new, top, start, tick - 1)
    return _add(firsts, lasts, new, top, start, END) if count >= number else top


@part
def _moved(
    firsts: Ints, lasts: Ints, begin: int, count: int, by_first: int, by_last: int, top: int
) -> int:
    """Runs with their ends moved, by at least as much to the left at their beginnings."""
    new = top
    for k in range(begin, begin + count):
        first = _shifted(firsts[k], by_first)
        top = _add(firsts, lasts, new, top, first, _shifted(lasts[k], by_last))
    return top


@part
def _everywhere(
    firsts: Ints, lasts: Ints, begin: int, count: int, by_first: int, by_last: int, top: int
) -> tuple[int, int]:
    """Ticks from which no tick of the complement is seen; begin and end of the list."""
    end = _complement(firsts, lasts, begin, count, top)
    moved = _moved(firsts, lasts, top, end - top, by_first, by_last, end)
    return moved, _complement(firsts, lasts, end, moved - end, moved)


@part
def _just_before(firsts: Ints, lasts: Ints, begin: int, count: int, top: int) -> int:
    new = top
    for k in range(begin, begin + count):
        last = lasts[k] if lasts[k] % 2 == 1 else lasts[k] - 1
        first = firsts[k] | 1
        if first <= last:
            top = _add(firsts, lasts, new, top, first, _shifted(last, 1))
    return top


@part
def _mirrored(firsts: Ints, lasts: Ints, begin: int, count: int, top: int) -> int:
    for k in range(begin + count - 1, begin - 1, -1):
        firsts[top], lasts[top] = -lasts[k], -firsts[k]
        top += 1
    return top


@part
def _until(  # noqa: PLR0913, PLR0917 - two lists and a window
    firsts: Ints,
    lasts: Ints,
    ours: int,
    our_count: int,
    theirs: int,
    their_count: int,
    a: int,
    b: int,
    lists: Ints,
    at: Ints,
    inside: Any,
    top: int,
) -> tuple[int, int]:
    """As `Runs.until`; begin and end of the list."""
    new, begin, stop = top, theirs, theirs + their_count
    for k in range(ours, ours + our_count):
        first, last = firsts[k], lasts[k]
        reach = last + 1 if last % 2 == 1 and last < END else last
        while begin < stop and lasts[begin] < first:
            begin += 1
        for other in range(begin, stop):
            if firsts[other] > reach:
                break
            low, high = max(firsts[other], first), min(lasts[other], reach)
            start = max(_shifted(low, -2 * b), first)
            end = min(_shifted(high, -2 * a), last)
            top = _add(firsts, lasts, new, top, start, end)
    if a > 0:
        return new, top
    lists[0, 0], lists[0, 1], lists[1, 0], lists[1, 1] = new, top - new, theirs, their_count
    return top, _in_many(firsts, lasts, lists[:2], 1, at, inside, top)


@part
def _held(  # noqa: PLR0913, PLR0917 - the columns of a channel
    earliest: Ints,
    latest: Ints,
    period: Ints,
    gap: Any,
    begin: int,
    end: int,
    until: int,
    first: Ints,
    last: Ints,
) -> int:
    """When each sample may hold, as `held_samples`; returns the frontier."""
    known = _FIRST if until == NO_UNTIL else 2 * until
    if begin == end:
        return known
    frontier = max(2 * earliest[end - 1] + 1, known)
    following = END
    for k in range(end - 1, begin - 1, -1):
        narrowed = latest[k] if following == END else min(latest[k], following // 2)
        latest[k] = narrowed
        ended = 2 * (narrowed + period[k]) if gap[k] else END
        last[k] = min(ended, following) - 1
        if k == end - 1:
            last[k] = min(last[k], max(2 * narrowed, frontier - 1))
        after = k > begin and earliest[k] == earliest[k - 1]
        first[k] = 2 * earliest[k] + after
        following = 2 * narrowed
    return int(frontier)


@part
def _of_atom(  # noqa: PLR0913, PLR0917 - the columns of a channel
    codes: Codes,
    bit: int,
    wanted: int,
    of_any: int,
    latest: Ints,
    period: Ints,
    gap: Any,
    begin: int,
    end: int,
    first: Ints,
    last: Ints,
    frontier: int,
    firsts: Ints,
    lasts: Ints,
    top: int,
) -> int:
    """Ticks at which a sample may hold whose code has a bit, or has it not, or any value may."""
    new = top
    any_ = (of_any & bit) == wanted
    if begin == end:
        known = frontier - 1 if frontier > _FIRST else _FIRST - 1
        if any_:
            top = _add(firsts, lasts, new, top, _FIRST, known)
            top = _add(firsts, lasts, new, top, frontier, END)
        return top
    if any_:
        top = _add(firsts, lasts, new, top, _FIRST, 2 * latest[begin] - 1)
    for k in range(begin, end):
        if (codes[k] & bit) == wanted:
            top = _put(firsts, lasts, new, top, first[k], last[k])
        if any_ and gap[k]:
            following = 2 * latest[k + 1] if k + 1 < end else frontier
            top = _put(firsts, lasts, new, top, first[k] + 2 * period[k], following - 1)
    return _put(firsts, lasts, new, top, frontier, END) if any_ else top


@part
def _walk(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917 - an instruction a branch
    program: Ints,
    atoms: Ints,
    frontiers: Ints,
    later: int,
    firsts: Ints,
    lasts: Ints,
    top: int,
    stack: Ints,
    lists: Ints,
    at: Ints,
    inside: Any,
) -> int:
    """Run a program: where it is certain and where possible, in the first row of ``stack``.

    With ``later`` 1, an atom holds after its frontier for certain, and does not possibly: what is
    then still open is open whatever the best.

    Returns:
        The end of the lists, or `FULL`.
    """
    height = 0
    for line in range(program.shape[0]):
        op, taken, a, b = program[line, 0], program[line, 1], program[line, 2], program[line, 3]
        number = program[line, 4]
        base = height - taken
        total = 0
        for k in range(base, height):
            total += stack[k, 1] + stack[k, 3]
        if op == _ATOM:
            total = atoms[a, 1] + atoms[a, 3]
        if top + 8 * total + _LEAST_ROOM > firsts.size:
            return FULL
        height = base + 1
        if op == _ATOM:
            begin = top
            top = _complement(firsts, lasts, atoms[a, 0], atoms[a, 1], top)
            if later:
                frontier, start = frontiers[a], top
                for k in range(begin, start):
                    if firsts[k] < frontier:
                        top = _add(firsts, lasts, start, top, firsts[k], lasts[k])
                top = _add(firsts, lasts, start, top, frontier, END)
                begin = start
            stack[base, 0], stack[base, 1] = begin, top - begin
            begin = top
            if later:
                for k in range(atoms[a, 2], atoms[a, 2] + atoms[a, 3]):
                    last = min(lasts[k], frontiers[a] - 1)
                    top = _add(firsts, lasts, begin, top, firsts[k], last)
                stack[base, 2], stack[base, 3] = begin, top - begin
            else:
                stack[base, 2], stack[base, 3] = atoms[a, 2], atoms[a, 3]
            continue
        if op in (_IMPLIES, _NOT):
            # A negation exchanges what is certain and what is possible.
            begin = top
            top = _complement(firsts, lasts, stack[base, 2], stack[base, 3], top)
            middle = top
            top = _complement(firsts, lasts, stack[base, 0], stack[base, 1], top)
            stack[base, 0], stack[base, 1] = begin, middle - begin
            stack[base, 2], stack[base, 3] = middle, top - middle
            if op == _NOT:
                continue
        before_begin = before_count = 0
        for side in range(2):
            low, size = stack[base, 2 * side], stack[base, 2 * side + 1]
            begin = top
            if op in (_AT_LEAST, _FEWER, _IMPLIES):
                for k in range(taken):
                    lists[k, 0] = stack[base + k, 2 * side]
                    lists[k, 1] = stack[base + k, 2 * side + 1]
                top = _in_many(firsts, lasts, lists[:taken], number, at, inside, top)
            elif op == _EVENTUALLY:
                top = _moved(firsts, lasts, low, size, -2 * b, -2 * a, top)
            elif op == _ONCE:
                top = _moved(firsts, lasts, low, size, 2 * a, 2 * b, top)
            elif op == _ALWAYS:
                begin, top = _everywhere(firsts, lasts, low, size, -2 * b, -2 * a, top)
            elif op == _HISTORICALLY:
                begin, top = _everywhere(firsts, lasts, low, size, 2 * a, 2 * b, top)
            elif op == _UNTIL:
                begin, top = _until(
                    firsts, lasts, low, size, stack[base + 1, 2 * side],
                    stack[base + 1, 2 * side + 1], a, b, lists, at, inside, top,
                )  # fmt: skip
            elif op == _SINCE:
                ours = top
                theirs = _mirrored(firsts, lasts, low, size, ours)
                other, count = stack[base + 1, 2 * side], stack[base + 1, 2 * side + 1]
                top = _mirrored(firsts, lasts, other, count, theirs)
                found, end = _until(
                    firsts, lasts, ours, size, theirs, count, a, b, lists, at, inside, top
                )
                begin = end
                top = _mirrored(firsts, lasts, found, end - found, end)
            else:
                # A rise holds now, and just before it did not; a fall the other way round.
                other = 2 - 2 * side
                top = _complement(firsts, lasts, stack[base, other], stack[base, other + 1], top)
                size_ = top - begin
                start = top
                if op == _RISE:
                    top = _just_before(firsts, lasts, begin, size_, top)
                    low_, size_ = low, size
                else:
                    top = _just_before(firsts, lasts, low, size, top)
                    low_ = begin
                lists[0, 0], lists[0, 1] = start, top - start
                lists[1, 0], lists[1, 1] = low_, size_
                begin = top
                top = _in_many(firsts, lasts, lists[:2], 2, at, inside, top)
            if side == 0:
                before_begin, before_count = begin, top - begin
        stack[base, 0], stack[base, 1] = before_begin, before_count
        stack[base, 2], stack[base, 3] = begin, top - begin
        if op == _FEWER:
            begin = top
            top = _complement(firsts, lasts, stack[base, 2], stack[base, 3], top)
            middle = top
            top = _complement(firsts, lasts, stack[base, 0], stack[base, 1], top)
            stack[base, 0], stack[base, 1] = begin, middle - begin
            stack[base, 2], stack[base, 3] = middle, top - middle
    return top


@kernel
def settle(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917 - one evaluation
    program: Ints,
    channel_of: Ints,
    of_any: Codes,
    times: Ints,
    gap: Any,
    spans: Ints,
    past: Ints,
    codes: Codes,
    held: Ints,
    listed: Ints,
    frontiers: Ints,
    settled: int,
    arena: Ints,
    scratch: tuple[Ints, Ints, Ints, Ints, Any],
    pieces: tuple[Ints, Codes],
) -> tuple[int, int]:
    """Evaluate the samples that are kept, and give the pieces that became final.

    Args:
        program: A row an instruction: `Op`, operands, a, b, number.
        channel_of: Of each atom; -1 for `Side.LISTED`.
        of_any: Code of each atom for any value.
        times: As of `accept`.
        gap: As of `accept`.
        spans: Of each channel begin, end and ``until``; begin is moved behind what is not needed.
        past: How many ns each channel is needed for.
        codes: Of each atom, a row each.
        held: Room for the first and last tick of each sample.
        listed: Of each atom that is `Side.LISTED`, begin and count of the ticks at which it is not
            certain and at which it is possible, at the beginning of ``arena``.
        frontiers: Of each atom; those that are not listed are written here.
        settled: The first tick whose verdict was not given.
        arena: Room for all lists.
        scratch: The stack, the lists of an instruction, atoms, positions and flags.
        pieces: First tick and code of each piece.

    Returns:
        How many pieces, or `FULL`, and the last tick that they cover.
    """
    firsts, lasts = arena[0], arena[1]
    stack, lists, atoms, at, inside = scratch
    earliest, latest, period = times[0], times[1], times[2]
    held_first, held_last = held[0], held[1]
    channels = spans.shape[0]
    top = 0
    for atom in range(channel_of.size):
        if channel_of[atom] < 0:
            top = max(top, listed[atom, 2] + listed[atom, 3])
    for c in range(channels):
        begin, end, until = spans[c, 0], spans[c, 1], spans[c, 2]
        frontier = _held(
            earliest[c], latest[c], period[c], gap[c], begin, end, until,
            held_first[c], held_last[c],
        )  # fmt: skip
        for atom in range(channel_of.size):
            if channel_of[atom] != c:
                continue
            if top + 4 * (end - begin) + _LEAST_ROOM > firsts.size:
                return FULL, 0
            frontiers[atom] = frontier
            for side in range(2):
                start = top
                top = _of_atom(
                    codes[atom], CERTAIN + side, 2 * side, of_any[atom], latest[c], period[c],
                    gap[c], begin, end, held_first[c], held_last[c], frontier, firsts, lasts, top,
                )  # fmt: skip
                atoms[atom, 2 * side], atoms[atom, 2 * side + 1] = start, top - start
    for atom in range(channel_of.size):
        if channel_of[atom] < 0:
            atoms[atom] = listed[atom]
    top = _walk(program, atoms, frontiers, 0, firsts, lasts, top, stack, lists, at, inside)
    if top == FULL:
        return FULL, 0
    certain, certain_count = stack[0, 0], stack[0, 1]
    possible, possible_count = stack[0, 2], stack[0, 3]
    top = _walk(program, atoms, frontiers, 1, firsts, lasts, top, stack, lists, at, inside)
    if top == FULL:
        return FULL, 0
    kept, kept_count, open_, open_count = stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3]
    total = certain_count + possible_count + kept_count + open_count
    if top + 4 * total + _LEAST_ROOM > firsts.size or 2 * total + 2 > pieces[0].size:
        return FULL, 0
    # Final: certain, or not possible, or open by what is there already.
    start = top
    top = _complement(firsts, lasts, kept, kept_count, top)
    lists[0, 0], lists[0, 1], lists[1, 0], lists[1, 1] = start, top - start, open_, open_count
    start = top
    top = _in_many(firsts, lasts, lists[:2], 2, at, inside, top)
    lists[2, 0], lists[2, 1] = start, top - start
    start = top
    top = _complement(firsts, lasts, possible, possible_count, top)
    lists[1, 0], lists[1, 1] = start, top - start
    lists[0, 0], lists[0, 1] = certain, certain_count
    start = top
    top = _in_many(firsts, lasts, lists[:3], 1, at, inside, top)
    final = _FIRST - 1
    for k in range(start, top):
        if firsts[k] <= settled <= lasts[k]:
            final = lasts[k]
    if final < settled:
        return 0, 0
    # The pieces: certain runs within possible ones.
    count, tick = 0, settled
    c = certain
    p = possible
    while tick <= final:
        while c < certain + certain_count and lasts[c] < tick:
            c += 1
        while p < possible + possible_count and lasts[p] < tick:
            p += 1
        code, last = 0, final
        if c < certain + certain_count:
            if firsts[c] <= tick:
                code, last = code + 1, min(last, lasts[c])
            else:
                last = min(last, firsts[c] - 1)
        if p < possible + possible_count:
            if firsts[p] <= tick:
                code, last = code + 1, min(last, lasts[p])
            else:
                last = min(last, firsts[p] - 1)
        pieces[0][count], pieces[1][count] = tick, code
        count += 1
        if last == END:
            break
        tick = last + 1
    if final < END:
        for c in range(channels):
            begin, end = spans[c, 0], spans[c, 1]
            needed = final - 2 * past[c]
            while begin < end - 1 and held_last[c][begin] < needed:
                begin += 1
            spans[c, 0] = begin
    return count, final
