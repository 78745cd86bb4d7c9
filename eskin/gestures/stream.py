"""Gestures of a skin whose samples arrive in pieces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.contacts import ContactStream
from eskin.contacts.components import label_components
from eskin.contacts.contacts import pressures_of, require_threshold
from eskin.contacts.stream import require_times
from eskin.contacts.tracks import BEFORE_ALL
from eskin.gestures.gestures import Gestures
from eskin.gestures.recognition import give_up, judge_bundle, judge_pair, judge_stray, judge_touch
from eskin.gestures.templates import Templates
from eskin.gestures.touches import (
    Bundle,
    Merging,
    Touch,
    boxes_of,
    centroids_of,
    follow,
    root,
    shared,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from eskin.contacts import Contacts, Skin
    from eskin.contacts.components import Flags, Indices
    from eskin.gestures.gestures import Gesture
    from eskin.gestures.recognition import Judged

_MOST_KEPT: Final = 256
"""Touches that have ended and wait: for others to pair with, and for their bundles to end."""


class GestureStream:
    """Recognises gestures of a skin whose samples arrive in pieces, in bounded memory.

    A gesture is given as soon as nothing that follows can change its verdict. Touches that have
    ended wait for others to make a pair with, and for the possibly pressed taxels around them to
    end. At most 256 wait for either: then the oldest ones are given up. Pairs with them are not
    sought, and of those that have not ended for certain, each kind is given as possible.

    A long touch is kept in at most 1024 pieces: its places get less exact the longer it lasts.

    Args:
        skin: The n taxels.
        threshold: Pressure in Pa above which a taxel is pressed, positive and finite.
        templates: What gestures are; ``None``: the default ones.

    Raises:
        ContactError: The threshold is not positive and finite.
    """

    def __init__(self, skin: Skin, threshold: float, templates: Templates | None = None) -> None:
        self._skin = skin
        self._threshold = require_threshold(threshold)
        self._contacts = ContactStream(skin, threshold)
        self._templates = Templates() if templates is None else templates
        self._owners = np.repeat(np.arange(len(skin)), np.diff(skin.starts))
        self._sample = 0
        self._quiet = True
        self._instant = (BEFORE_ALL, BEFORE_ALL)
        self._rest()

    def feed(self, lo: ArrayLike, hi: ArrayLike, times: ArrayLike) -> Gestures:
        """Take the next samples, in order.

        A lost sample is one of which nothing is known: a row of NaN.

        Args:
            lo: Lower bounds of the pressures in Pa, shape ``(samples, n)``; ``-inf`` or NaN where
                unknown.
            hi: Upper bounds in Pa; ``inf`` or NaN where unknown.
            times: Enclosure of each sample's instant, shape ``(samples, 2)``, whole ns (UTC): its
                earliest and its latest.

        Returns:
            The gestures that are decided here.

        Raises:
            ContactError: Times are no enclosures, or run backwards.
            IntervalError: Bounds are no intervals, or shapes do not fit.
        """
        instants = require_times(times, self._instant)
        lows, highs = pressures_of(lo, hi, (len(instants), len(self._skin)))
        rest: list[bool] = np.all(highs <= self._threshold, axis=1).tolist()  # NaN is no rest
        found: list[Gesture] = []
        for k, instant in enumerate(instants):
            if not (rest[k] and self._quiet):
                found += self._step(self._contacts.follow(lows[k], highs[k], instant), instant)
                self._quiet = rest[k]
            self._sample += 1
            self._instant = instant
        return Gestures(found)

    def finish(self) -> Gestures:
        """Say that the record ends: nothing is known of what follows.

        Returns:
            The gestures that were not decided.
        """
        found = self._settle_strays(np.zeros(len(self._skin), np.bool_))
        for objects in (self._bundles, self._strays):
            _join(objects)
            for one in _alive(objects):
                one.open_end = True
        found += self._close(_alive(self._bundles))
        found += self._close_strays(_alive(self._strays))
        self._contacts.finish()
        self._rest()
        return Gestures(found)

    def _rest(self) -> None:
        """Forget the last instant."""
        nothing = np.full(len(self._skin), -1, np.int64)
        self._begun = self._sample
        self._quiet = True
        self._regions = self._cores = self._free = nothing
        self._bundles: list[Bundle] = []
        self._touches: list[Touch] = []
        self._strays: list[Bundle] = []
        self._kept: list[Judged] = []
        self._pending: Flags | None = None

    def _step(self, contacts: Contacts, instant: tuple[int, int]) -> list[Gesture]:
        """Take one sample, of which the contacts are known."""
        certain = contacts.core_of >= 0
        found = self._settle_strays(certain)
        before = self._bundles
        self._bundles = follow(
            before,
            shared(self._regions, contacts.region_of),
            len(contacts.regions),
            lambda _: self._bundle(self._sample, instant),
        )
        if self._sample == self._begun:
            self._bundles = _join(self._bundles)
        alive = _alive(self._bundles)
        self._follow_touches(contacts, instant)
        if alive:
            self._measure(contacts, alive, instant[1])
        found += self._close([each for each in _alive(before) if each not in alive])
        if alive:
            self._pending = (contacts.region_of >= 0) & ~self._beside(certain) & (self._cores < 0)
        else:
            found += self._close_strays(_alive(self._strays))
            self._strays, self._free = [], contacts.region_of
        self._regions, self._cores = contacts.region_of, contacts.core_of
        self._drop(instant[0])
        return found + self._give_up(alive)

    def _bundle(self, sample: int, instant: tuple[int, int]) -> Bundle:
        return Bundle(sample, sample, *instant, open_begin=sample == self._begun)

    def _follow_touches(self, contacts: Contacts, instant: tuple[int, int]) -> None:
        labels, regions = self._contacts.labels, contacts.table["region"].tolist()

        def begin(core: int) -> Touch:
            bundle = self._bundles[regions[core]]
            touch = Touch(self._sample, self._sample, instant[1], instant[0], labels[core], bundle)
            bundle.touches.append(touch)
            return touch

        pairs = shared(self._cores, contacts.core_of)
        self._touches = follow(self._touches, pairs, len(contacts), begin)
        for touch, label in zip(self._touches, labels, strict=True):
            touch.last, touch.end = self._sample, instant[0]
            touch.contact = min(touch.contact, label)

    def _measure(self, contacts: Contacts, alive: Sequence[Bundle], latest: int) -> None:
        """Where bundles and touches are at a sample."""
        regions = _relabelled(contacts.region_of, self._bundles, alive)
        boxes = boxes_of(regions, len(alive), self._skin)
        for bundle, box in zip(alive, boxes, strict=True):
            bundle.reach(self._sample, latest, box)
        touches = _alive(self._touches)
        if not touches:
            return
        cores = _relabelled(contacts.core_of, self._touches, touches)
        own = np.array([alive.index(touch.bundle) for touch in touches], np.int64)
        places = centroids_of(cores, regions, own, self._skin)
        for touch, box in zip(touches, places, strict=True):
            touch.reach(self._sample, box)

    def _close(self, ended: Sequence[Bundle]) -> list[Gesture]:
        """Judge what has ended."""
        found: list[Gesture] = []
        for bundle in ended:
            if len(bundle.touches) > 1 or bundle.given_up:
                found += judge_bundle(bundle, self._templates)
            for touch in bundle.touches:
                judged = judge_touch(touch, self._templates)
                found += judged.gestures()
                for other in self._kept:
                    if other.bundle is not bundle:
                        found += judge_pair(other, judged, self._templates)
                self._kept.append(judged)
        return found

    def _drop(self, now: int) -> None:
        """Forget touches that no other can make a pair with, and the oldest of too many."""
        if not self._kept:
            return
        oldest = min([now, *(bundle.begin for bundle in _alive(self._bundles))])
        self._kept = [
            each
            for each in self._kept[-_MOST_KEPT:]
            if each.bundle.end + self._templates.pause_ns >= oldest
        ]

    def _give_up(self, alive: Sequence[Bundle]) -> list[Gesture]:
        """Stop to follow the oldest of too many touches that ended in bundles that go on."""
        if sum(len(bundle.touches) for bundle in alive) <= _MOST_KEPT:
            return []
        waiting = [
            touch for bundle in alive for touch in bundle.touches if touch.last < self._sample
        ]
        waiting.sort(key=lambda touch: touch.last)
        gone = waiting[: max(0, len(waiting) - _MOST_KEPT)]
        for touch in gone:
            touch.bundle.touches.remove(touch)
            touch.bundle.given_up = True
        return [each for touch in gone for each in give_up(touch)]

    def _beside(self, certain: Flags) -> Flags:
        """Which taxels are certainly pressed, or beside one that is."""
        beside = certain.copy()
        if certain.any():
            beside[self._skin.neighbours[certain[self._owners]]] = True
        return beside

    def _settle_strays(self, certain: Flags) -> list[Gesture]:
        """Follow the touches without a core of the last sample, now that the next one is known."""
        if self._pending is None:
            return []
        free = self._pending & ~certain
        self._pending = None
        sample = self._sample - 1
        before, labels = self._strays, np.full(free.size, -1, np.int64)
        count = 0
        if free.any():
            count = label_components(free, self._skin.starts, self._skin.neighbours, labels)
        self._strays = follow(
            before,
            shared(self._free, labels),
            count,
            lambda _: self._bundle(sample, self._instant),
        )
        if sample == self._begun:
            self._strays = _join(self._strays)
        alive = _alive(self._strays)
        if alive:
            boxes = boxes_of(_relabelled(labels, self._strays, alive), len(alive), self._skin)
            for stray, box in zip(alive, boxes, strict=True):
                stray.reach(sample, self._instant[1], box)
        self._free = labels
        return self._close_strays([each for each in _alive(before) if each not in alive])

    def _close_strays(self, ended: Sequence[Bundle]) -> list[Gesture]:
        return [each for stray in ended for each in judge_stray(stray, self._templates)]


def find_gestures(
    lo: ArrayLike,
    hi: ArrayLike,
    times: ArrayLike,
    skin: Skin,
    threshold: float,
    templates: Templates | None = None,
) -> Gestures:
    """Gestures of a whole record.

    Args:
        lo: Lower bounds of the pressures in Pa, shape ``(samples, n)``; ``-inf`` or NaN where
            unknown.
        hi: Upper bounds in Pa; ``inf`` or NaN where unknown.
        times: Enclosure of each sample's instant, shape ``(samples, 2)``, whole ns (UTC): its
            earliest and its latest.
        skin: The n taxels.
        threshold: Pressure in Pa above which a taxel is pressed, positive and finite.
        templates: What gestures are; ``None``: the default ones.

    Raises:
        ContactError: The threshold is not positive and finite, times are no enclosures, or they run
            backwards.
        IntervalError: Bounds are no intervals, or shapes do not fit.
    """
    stream = GestureStream(skin, threshold, templates)
    return Gestures([*stream.feed(lo, hi, times), *stream.finish()])


def _alive(objects: Sequence[Merging]) -> list[Merging]:
    """What objects have become, each once."""
    return list(dict.fromkeys(root(each) for each in objects))


def _join(bundles: Sequence[Bundle]) -> list[Bundle]:
    """Make one bundle of all: nothing is known of what is before or after the record."""
    for each in _alive(bundles)[1:]:
        root(bundles[0]).absorb(each)
    return [root(each) for each in bundles]


def _relabelled(labels: Indices, objects: Sequence[object], every: Sequence[object]) -> Indices:
    """The number of each taxel's object."""
    numbers = {id(each): k for k, each in enumerate(every)}
    table = np.array([*(numbers[id(each)] for each in objects), -1], np.int64)
    return table[labels]
