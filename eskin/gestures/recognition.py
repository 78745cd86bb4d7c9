"""Which templates a touch, or two, satisfy: certainly, possibly, or not."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isinf, nextafter, pi
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.constants import TWO_PI
from eskin.gestures.gestures import Gesture, TouchPlaces
from eskin.gestures.templates import PAIR_KINDS, TOUCH_KINDS
from eskin.gestures.touches import around
from eskin.interval import Interval, Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from eskin.gestures.gestures import Bounds
    from eskin.gestures.templates import Kind, Templates
    from eskin.gestures.touches import Bundle, Touch
    from eskin.interval import Floats, Verdicts

    Span = tuple[int | None, int | None]

_NS: Final = 1e9
_HALF_TURN: Final = TWO_PI / 2.0
_COSINE: Final = Interval(3.0).sqrt() / 2.0
"""Of 30°, the least angle of a rotation."""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A touch whose bundle has ended.

    Attributes:
        touch: The touch.
        bundle: Its bundle.
        begin: Earliest and latest instant of its first sample.
        end: The same of its last one.
        start: Box of its first centroid.
        stop: Box of its last one.
        verdicts: Of each kind of a touch.
    """

    touch: Touch
    bundle: Bundle
    begin: Span
    end: Span
    start: Floats
    stop: Floats
    verdicts: Mapping[Kind, Verdict]
    direction: Bounds | None

    @property
    def places(self) -> TouchPlaces:
        """Where it begins and ends."""
        return TouchPlaces(_bounds_of(self.start), _bounds_of(self.stop))

    def gestures(self) -> Iterator[Gesture]:
        """What it may be."""
        contacts, places = (self.touch.contact,), (self.places,)
        for kind, verdict in self.verdicts.items():
            if verdict > Verdict.IMPOSSIBLE:
                way = self.direction if kind in {"slide", "swipe"} else None
                yield Gesture(
                    kind, verdict, contacts, self.begin, self.end, direction=way, places=places
                )


def judge_touch(touch: Touch, templates: Templates) -> Judged:
    """Judge a touch whose bundle has ended."""
    bundle = touch.bundle
    begin = None if bundle.open_begin else bundle.begin, touch.begin
    end = touch.end, None if bundle.open_end else bundle.end
    every = bundle.boxes(bundle.first, bundle.last, touch)
    start = around(bundle.boxes(bundle.first, touch.first, touch))
    stop = around(bundle.boxes(touch.last, bundle.last, touch))
    sure = bundle.boxes(touch.first, touch.last, touch)
    widest = Interval(every[:, 1].max(axis=0)) - every[:, 0].min(axis=0)
    least = Interval(sure[:, 0].max(axis=0)) - sure[:, 1].min(axis=0)
    farthest = float(widest.sup.max())
    if bundle.open_begin or bundle.open_end:
        farthest = inf
    if bundle.open_begin:
        start = _anywhere(start)
    if bundle.open_end:
        stop = _anywhere(stop)
    extent = Interval(max(0.0, float(least.inf.max())), farthest)
    way = _between(start, stop)
    lasts = max(0, touch.end - touch.begin), _difference(begin[0], end[1])
    verdicts = judge_measures(lasts, extent, way, templates)
    return Judged(touch, bundle, begin, end, start, stop, verdicts, angle_of(way))


def judge_bundle(bundle: Bundle, templates: Templates) -> Iterator[Gesture]:
    """What pairs of a bundle's touches may make: they may be one touch, so nothing is certain."""
    begin = None if bundle.open_begin else bundle.begin
    end = None if bundle.open_end else bundle.end
    together = _at_least((0, _difference(begin, end)), templates.together_ns)
    for kind in PAIR_KINDS:
        if kind == "double tap" or together > Verdict.IMPOSSIBLE:
            yield Gesture(kind, Verdict.POSSIBLE, (), (begin, end), (begin, end))


def give_up(touch: Touch) -> Iterator[Gesture]:
    """What a touch may be whose bundle goes on, and is not waited for."""
    for kind in TOUCH_KINDS:
        begin, end = (None, touch.begin), (touch.end, None)
        yield Gesture(kind, Verdict.POSSIBLE, (touch.contact,), begin, end)


def judge_stray(bundle: Bundle, templates: Templates) -> Iterator[Gesture]:
    """What touches without a core, within some taxels, may be."""
    box = around(bundle.boxes(bundle.first, bundle.last))
    begin = None if bundle.open_begin else bundle.begin
    end = None if bundle.open_end else bundle.end
    kinds: list[Kind] = ["tap"]
    if begin is None or end is None:
        box = _anywhere(box)
    if not _is_little(box, _difference(begin, end), templates):
        way = _between(box, box)
        extent = Interval(0.0, float(way.sup.max()))
        verdicts = judge_measures((0, _difference(begin, end)), extent, way, templates)
        kinds = [kind for kind, verdict in verdicts.items() if verdict > Verdict.IMPOSSIBLE]
    place = _bounds_of(box)
    for kind in kinds:
        yield Gesture(
            kind, Verdict.POSSIBLE, (), (begin, end), (begin, end),
            places=(TouchPlaces(place, place),),
        )  # fmt: skip


def _is_little(box: Floats, lasts: int | None, templates: Templates) -> bool:
    """Whether it is clear without care for rounding that only a tap fits: of noise most."""
    if lasts is None or lasts > templates.tap_ns:
        return False
    # A diagonal is at most 1.74 times the longest side.
    return bool(1.8 * (box[1] - box[0]).max() < templates.slide_m)


def judge_measures(
    lasts: tuple[int, int | None], extent: Interval, way: Interval, templates: Templates
) -> dict[Kind, Verdict]:
    """Judge a touch by its enclosed measures.

    Args:
        lasts: Least and greatest time from its first to its last sample, in ns.
        extent: How far its centroid moves along the coordinate where it moves farthest, in m.
        way: From its first to its last centroid, in m, shape ``(d,)``.
        templates: The constants.
    """
    still = _single(extent <= templates.still_m)
    far = _length_squared(way)
    moved = _single(far >= Interval(templates.slide_m).sqr())
    short = _at_most(lasts, templates.tap_ns)
    long = _at_least(lasts, templates.hold_ns)
    seconds = _interval(lasts) / _NS
    fast = _single(far >= (templates.swipe_m_per_s * seconds).sqr())
    return {
        "tap": min(still, short),
        "press": min(still, _not(short), _not(long)),
        "hold": min(still, long),
        "slide": min(moved, _not(fast)),
        "swipe": min(moved, fast),
    }


def judge_pair(one: Judged, two: Judged, templates: Templates) -> Iterator[Gesture]:
    """What two touches make together; their bundles are two, so they are."""
    yield from _judge_double_tap(one, two, templates)
    yield from _judge_double_tap(two, one, templates)
    yield from _judge_together(one, two, templates)


def _judge_double_tap(first: Judged, second: Judged, templates: Templates) -> Iterator[Gesture]:
    if first.touch.last >= second.touch.first:
        return
    after = first.bundle.last < second.bundle.first
    pause = (
        _difference(first.end[1], second.begin[0]),
        _difference(first.end[0], second.begin[1]),
    )
    soon = _at_most(pause, templates.pause_ns)
    tapped = min(first.verdicts["tap"], second.verdicts["tap"])
    if Verdict.IMPOSSIBLE in {soon, tapped}:
        return
    far = _length_squared(_between(first.start, second.start))
    near = _single(far <= Interval(templates.apart_m).sqr())
    follows = Verdict.CERTAIN if after else Verdict.POSSIBLE
    verdict = min(follows, soon, near, tapped)
    if verdict > Verdict.IMPOSSIBLE:
        contacts = first.touch.contact, second.touch.contact
        places = first.places, second.places
        yield Gesture("double tap", verdict, contacts, first.begin, second.end, places=places)


def _judge_together(one: Judged, two: Judged, templates: Templates) -> Iterator[Gesture]:
    a, b = one.touch, two.touch
    earliest, latest = (
        max(one.bundle.first, two.bundle.first),
        min(one.bundle.last, two.bundle.last),
    )
    if earliest > latest:
        return
    begins, ends = max(a.first, b.first), min(a.last, b.last)
    begin = _latest(one.begin, two.begin)
    end = _earliest(one.end, two.end)
    lasts = _difference(begin[1], end[0]), _difference(begin[0], end[1])
    together = _at_least(lasts, templates.together_ns)
    if together == Verdict.IMPOSSIBLE:
        return
    before = _apart(one, two, earliest, min(begins, latest))
    after = _apart(one, two, max(ends, earliest), latest)
    # What the record cuts may have been anywhere.
    if one.bundle.open_begin and two.bundle.open_begin:
        before = Interval.entire(before.shape)
    if one.bundle.open_end and two.bundle.open_end:
        after = Interval.entire(after.shape)
    was, became = _length_squared(before), _length_squared(after)
    near = min(_single(each <= Interval(templates.span_m).sqr()) for each in (was, became))
    factor = Interval(templates.scale).sqr()
    some = _single(was > 0.0), _single(became > 0.0)
    shrinks = min(_single(became * factor <= was), some[0])
    grows = min(_single(became >= was * factor), some[1])
    turn = _turn(angle_of(before), angle_of(after))
    turns = Verdict.POSSIBLE
    if turn is not None:
        turns = _single(Interval(*turn).cos() <= _COSINE)
    verdicts: dict[Kind, Verdict] = {
        "pinch": shrinks,
        "spread": grows,
        "rotation": min(turns, _not(shrinks), _not(grows), *some),
    }
    scale = (became / was).sqrt()
    if scale.is_empty:
        scale = Interval(0.0, inf)
    for kind, verdict in verdicts.items():
        every = min(verdict, near, together)
        if every > Verdict.IMPOSSIBLE:
            yield Gesture(
                kind, every, (a.contact, b.contact), begin, end,
                angle=turn, scale=(float(scale.inf), float(scale.sup)),
                places=(one.places, two.places),
            )  # fmt: skip


def _apart(one: Judged, two: Judged, first: int, last: int) -> Interval:
    """From the one touch's centroid to the other's, at any sample of some."""
    shift = max(one.bundle.shift, two.bundle.shift)
    found = []
    for block in range(first >> shift, (last >> shift) + 1):
        begin, end = max(first, block << shift), min(last, ((block + 1) << shift) - 1)
        boxes = [around(each.bundle.boxes(begin, end, each.touch)) for each in (one, two)]
        found.append(_between(*boxes))
    every = Interval.stack(found)
    return Interval(every.inf.min(axis=0), every.sup.max(axis=0))


def angle_of(way: Interval) -> Bounds | None:
    """Enclosure of the angle of a vector in its first two coordinates; ``None``: any, or none."""
    x, y = way[0], way[1] if way.shape[0] > 1 else Interval(0.0)
    if x.contains(0.0) and y.contains(0.0):
        return None
    # The cut of atan2 is where x is negative: turn by half a turn.
    angle = (-y).atan2(-x) + _HALF_TURN if float(x.sup) < 0.0 else y.atan2(x)
    if float(angle.inf) > pi:
        angle -= TWO_PI
    return float(angle.inf), float(angle.sup)


def _turn(before: Bounds | None, after: Bounds | None) -> Bounds | None:
    if before is None or after is None:
        return None
    turn = Interval(*after) - Interval(*before)
    middle = float(turn.mid)
    if middle > pi:
        turn -= TWO_PI
    elif middle < -pi:
        turn += TWO_PI
    if float(turn.wid) >= 2.0 * pi:
        return None
    return float(turn.inf), float(turn.sup)


def _between(one: Floats, two: Floats) -> Interval:
    return Interval(two[0], two[1]) - Interval(one[0], one[1])


def _length_squared(way: Interval) -> Interval:
    return way.sqr().sum()


def _difference(one: int | None, two: int | None) -> int | None:
    return None if one is None or two is None else two - one


def _single(verdicts: Verdicts) -> Verdict:
    return Verdict(int(verdicts.codes))


def _not(verdict: Verdict) -> Verdict:
    return Verdict(2 - verdict)


def _at_most(span: Span, limit: int) -> Verdict:
    if span[1] is not None and span[1] <= limit:
        return Verdict.CERTAIN
    return Verdict.IMPOSSIBLE if span[0] is not None and span[0] > limit else Verdict.POSSIBLE


def _at_least(span: Span, limit: int) -> Verdict:
    return _not(_at_most(span, limit - 1))


def _latest(one: Span, two: Span) -> Span:
    """Of the later of two instants."""
    low = [bound for bound in (one[0], two[0]) if bound is not None]
    high = [bound for bound in (one[1], two[1]) if bound is not None]
    return max(low, default=None), max(high) if len(high) == 2 else None


def _earliest(one: Span, two: Span) -> Span:
    """Of the earlier of two instants."""
    low = [bound for bound in (one[0], two[0]) if bound is not None]
    high = [bound for bound in (one[1], two[1]) if bound is not None]
    return min(low) if len(low) == 2 else None, min(high, default=None)


def _interval(span: Span) -> Interval:
    """Enclosure of whole ns, as floats."""
    low = -inf if span[0] is None else float(span[0])
    high = inf if span[1] is None else float(span[1])
    if not isinf(low) and int(low) > (span[0] or 0):
        low = nextafter(low, -inf)
    if not isinf(high) and int(high) < (span[1] or 0):
        high = nextafter(high, inf)
    return Interval(low, high)


def _bounds_of(box: Floats) -> tuple[Bounds, ...]:
    return tuple((low, high) for low, high in box.T.tolist())


def _anywhere(box: Floats) -> Floats:
    return np.stack([np.full(box.shape[1], -inf), np.full(box.shape[1], inf)])
