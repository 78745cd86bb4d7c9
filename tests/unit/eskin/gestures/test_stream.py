"""Gestures of samples that arrive in pieces, in bounded memory, and after a record has ended."""

from __future__ import annotations

from collections import Counter
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from eskin.contacts import Skin
from eskin.errors import ContactError, IntervalError
from eskin.gestures import Gestures, GestureStream, find_gestures
from eskin.gestures.templates import TOUCH_KINDS
from eskin.interval import Verdict
from tests.unit.eskin.gestures.worlds import TEMPLATES, THRESHOLD, check, draw_world

if TYPE_CHECKING:
    from eskin.gestures import Gesture

SKIN = Skin.grid(1, 6, pitch=1.0, area=1.0)
_BOUNDS = {".": (0.0, 100.0), "?": (500.0, 1500.0), "#": (1500.0, 1600.0), "x": (nan, nan)}


def bounds(*rows: str) -> tuple[Any, Any, Any]:
    """Instants of a row of taxels: ``#`` certain, ``?`` possible, ``x`` unknown, ``.`` not."""
    lo, hi = np.array([[_BOUNDS[each] for each in row] for row in rows]).transpose(2, 0, 1)
    earliest = 10 * np.arange(len(rows))
    return lo, hi, np.stack([earliest, earliest], axis=1)


def in_pieces(*record: Any) -> Gestures:
    lo, hi, times, skin, threshold, templates = record
    stream = GestureStream(skin, threshold, templates)
    found: list[Gesture] = []
    for k in range(0, len(times), 3):
        found += stream.feed(lo[k : k + 3], hi[k : k + 3], times[k : k + 3])
    return Gestures([*found, *stream.finish()])


def kinds(found: Gestures) -> Counter[tuple[str, Verdict]]:
    return Counter((each.kind, each.verdict) for each in found)


def test_pieces_give_what_the_whole_gives() -> None:
    random = np.random.default_rng(3)
    for _ in range(40):
        world = draw_world(random)
        assert list(world.found(in_pieces)) == list(world.found())


@pytest.mark.parametrize("blocks", [1, 2, 3])
def test_answers_hold_where_places_are_kept_in_few_blocks(
    blocks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin.gestures.touches.MOST_BLOCKS", blocks)
    random = np.random.default_rng(4)
    counts: Counter[str] = Counter()
    for _ in range(60):
        world = draw_world(random)
        counts += check(world, world.found())
    assert counts["hold certain"] > 0
    assert counts["sought"] > 50


def test_long_hold_stays_certain_in_bounded_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eskin.gestures.touches.MOST_BLOCKS", 8)
    stream = GestureStream(SKIN, THRESHOLD, TEMPLATES)
    lo, hi, _ = bounds("......", *["..?#?."] * 500, "......")
    times = 10 * np.arange(len(lo))
    found = stream.feed(lo, hi, np.stack([times, times], axis=1))
    assert kinds(found) == {("hold", Verdict.CERTAIN): 1}


def test_gesture_is_given_when_it_is_decided() -> None:
    stream = GestureStream(SKIN, THRESHOLD, TEMPLATES)
    lo, hi, times = bounds("......", "..#...", "..#...", "......", "......")
    given = [list(stream.feed(lo[k : k + 1], hi[k : k + 1], times[k : k + 1])) for k in range(5)]
    assert [len(each) for each in given] == [0, 0, 0, 1, 0]
    assert given[3][0].begin == (10, 10)
    assert given[3][0].end == (20, 20)
    assert len(stream.finish()) == 0


def test_record_that_ended_is_linked_to_nothing() -> None:
    stream = GestureStream(SKIN, THRESHOLD, TEMPLATES)
    lo, hi, times = bounds("......", "..#...")
    stream.feed(lo, hi, times)
    first = stream.finish()
    second = Gestures([*stream.feed(*bounds("..#...", "......")[:2], times + 20), *stream.finish()])
    for found, begin, end in (
        (first, (10, 10), (10, None)),
        (second, (None, 20), (20, 20)),
    ):
        assert {each.verdict for each in found} == {Verdict.POSSIBLE}
        assert {each.kind for each in found} == set(TOUCH_KINDS)
        assert (found[0].begin, found[0].end) == (begin, end)


def test_lost_sample_leaves_all_open() -> None:
    rows = ("......", "..#...", "......")
    known = find_gestures(*bounds(*rows), SKIN, THRESHOLD, TEMPLATES)
    lost = find_gestures(*bounds(rows[0], rows[1], "xxxxxx", rows[2]), SKIN, THRESHOLD, TEMPLATES)
    assert kinds(known) == {("tap", Verdict.CERTAIN): 1}
    assert not lost.certain
    assert {each.kind for each in lost} == {"tap", "slide", "swipe"}


def test_touches_beside_a_broken_taxel_are_given_up_and_stay_possible() -> None:
    stream = GestureStream(SKIN, THRESHOLD, TEMPLATES)
    taps = 270
    lo, hi, _ = bounds(*["x.....", "x#....", "x....."] * taps)
    times = 10 * np.arange(len(lo))
    found = stream.feed(lo, hi, np.stack([times, times], axis=1))
    every = [*found, *stream.finish()]
    given = [each for each in found if each.kind == "tap" and each.contacts]
    own = [each for each in every if each.kind == "tap" and each.contacts]
    assert 0 < len(given) < len(own) == taps
    assert {each.verdict for each in every} == {Verdict.POSSIBLE}


def test_what_cannot_be_used_is_rejected_and_changes_nothing() -> None:
    stream = GestureStream(SKIN, THRESHOLD, TEMPLATES)
    lo, hi, times = bounds("......", "..#...", "......")
    with pytest.raises(ContactError):
        stream.feed(lo, hi, times[::-1])
    with pytest.raises(IntervalError):
        stream.feed(hi, lo, times)
    with pytest.raises(ContactError):
        GestureStream(SKIN, 0.0)
    found = stream.feed(lo, hi, times)
    assert kinds(found) == {("tap", Verdict.CERTAIN): 1}
