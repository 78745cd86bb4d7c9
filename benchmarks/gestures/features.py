"""What a classifier sees of a record: numbers from the middles of its intervals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.gestures.scenes import THRESHOLD
from eskin.contacts import find_contacts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.gestures.scenes import Record

    Floats = NDArray[np.float64]
    Flags = NDArray[np.bool_]

_ABSENT: Final = -1.0


def features(record: Record) -> list[float]:
    """Durations, pauses, counts, ways, speeds, distances and angles, of middles as if exact."""
    known = np.isfinite(record.lo) & np.isfinite(record.hi)
    middle = 0.5 * (np.where(known, record.lo, 0.0) + np.where(known, record.hi, 0.0))
    seconds = record.times.mean(axis=1) / 1e9
    period = float(np.median(np.diff(seconds)))
    pressed = middle > THRESHOLD
    count = pressed.sum(axis=1)
    inside = np.flatnonzero(count)
    found = [
        float(count.max()), float(count.sum()), float(middle.max()), float(len(inside)),
        float(known.mean()),
    ]  # fmt: skip
    if inside.size == 0:
        return found + [_ABSENT] * 27
    edges = np.diff(np.concatenate([[0], (count > 0).astype(np.int64), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    lengths = (ends - begins) * period
    pauses = (begins[1:] - ends[:-1]) * period
    found += [
        float(len(begins)), float(lengths.max()), float(lengths.min()), float(lengths[0]),
        float(lengths[-1]), float(pauses.max(initial=0.0)),
        float(seconds[inside[-1]] - seconds[inside[0]]),
    ]  # fmt: skip
    longest = int(lengths.argmax())
    return (
        found
        + _way(record, middle, pressed, begins[longest], ends[longest])
        + _two(record, middle, pressed)
    )


def _centre(record: Record, weights: Floats) -> Floats:
    return np.asarray(weights @ record.skin.positions / weights.sum())


def _way(record: Record, middle: Floats, pressed: Flags, begin: int, end: int) -> list[float]:
    """Of the longest stretch in which something is pressed."""
    places = np.array([_centre(record, pressed[k].astype(float)) for k in range(begin, end)])
    weighted = np.array(
        [_centre(record, np.where(pressed[k], middle[k], 0.0)) for k in range(begin, end)]
    )
    found: list[float] = []
    for each in (places, weighted):
        way = each[-1] - each[0]
        length = float(np.hypot(*way))
        lasts = max((end - begin - 1) * 0.01, 0.005)
        steps = np.linalg.norm(np.diff(each, axis=0), axis=1)
        found += [
            length, length / lasts, float(np.ptp(each, axis=0).max()), float(steps.sum()),
            float(steps.max(initial=0.0)),
        ]  # fmt: skip
    return found


def _two(record: Record, middle: Floats, pressed: Flags) -> list[float]:
    """Of two contacts at once: distance and angle at the first and the last instant."""
    ways: list[Floats] = []
    fingers = []
    most = 0
    for k in range(len(middle)):
        if not pressed[k].any():
            continue
        cores = find_contacts(middle[k], middle[k], record.skin, THRESHOLD)
        most = max(most, len(cores))
        centres = [np.mean(each.centroid, axis=1) for each in cores if each.cells[0] > 1]
        if len(centres) == 2:
            if ways and (centres[1] - centres[0]) @ ways[-1] < 0.0:
                centres.reverse()
            ways.append(centres[1] - centres[0])
            fingers.append(k)
    taps = _taps(record, pressed)
    if len(ways) < 2:
        return [float(most), float(len(ways)), *([_ABSENT] * 7), *taps]
    first, last = ways[0], ways[-1]
    distances = np.linalg.norm(ways, axis=1)
    ratio = float(distances[-1] / distances[0])
    turn = math.atan2(first[0] * last[1] - first[1] * last[0], float(first @ last))
    return [
        float(most), float(len(ways)), ratio, math.log(ratio), abs(turn), abs(math.sin(turn)),
        float(distances[0]), float(distances[-1]), (fingers[-1] - fingers[0]) * 0.01, *taps,
    ]  # fmt: skip


def _taps(record: Record, pressed: Flags) -> list[float]:
    """How far apart the first and the last pressed taxels are."""
    inside = np.flatnonzero(pressed.any(axis=1))
    first, last = (_centre(record, pressed[inside[k]].astype(float)) for k in (0, -1))
    return [float(np.hypot(*(last - first)))]
