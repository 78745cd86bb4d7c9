"""Ranges of whole numbers, such as those of tiles: from a first one up to, and without, an end."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable

Range: TypeAlias = tuple[int, int]


def merged(ranges: Iterable[Range]) -> list[Range]:
    """Sort ranges, and merge those that touch."""
    found: list[Range] = []
    for first, end in sorted(ranges):
        if first >= end:
            continue
        if found and first <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], end)
        else:
            found.append((first, end))
    return found


def without(ranges: Iterable[Range], holes: Iterable[Range]) -> list[Range]:
    """Ranges without ``holes``; both sorted and disjoint."""
    left: list[Range] = []
    waiting = list(holes)[::-1]
    for first, end in ranges:
        begin = first
        while waiting and waiting[-1][0] < end:
            hole = waiting[-1]
            if hole[0] > begin:
                left.append((begin, hole[0]))
            begin = max(begin, hole[1])
            if hole[1] > end:
                break
            waiting.pop()
        if begin < end:
            left.append((begin, end))
    return left


def common(ranges: Iterable[Range], others: Iterable[Range]) -> list[Range]:
    """What lies in both; each sorted and disjoint."""
    ranges = list(ranges)
    return without(ranges, without(ranges, others))


def coarsened(ranges: Iterable[Range], bits: int) -> list[Range]:
    """The ranges in units ``2^bits`` times larger that cover all of these."""
    return merged((first >> bits, -(-end >> bits)) for first, end in ranges)


def refined(ranges: Iterable[Range], bits: int) -> list[Range]:
    """The same ranges in units ``2^bits`` times smaller."""
    return [(first << bits, end << bits) for first, end in ranges]
