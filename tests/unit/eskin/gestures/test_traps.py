"""What looks certain or impossible, and is neither."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from eskin.contacts import Skin
from eskin.gestures import find_gestures
from eskin.interval import Verdict
from tests.unit.eskin.gestures.test_stream import bounds
from tests.unit.eskin.gestures.worlds import TEMPLATES, THRESHOLD

if TYPE_CHECKING:
    from eskin.gestures import Templates


def verdicts(*rows: str, templates: Templates = TEMPLATES) -> dict[str, Verdict]:
    """The greatest verdict of each kind that is listed of touches with a core."""
    skin = Skin.grid(1, len(rows[0]), pitch=1.0, area=1.0)
    found = find_gestures(*bounds(*rows), skin, THRESHOLD, templates)
    return {
        kind: max(each.verdict for each in found if each.kind == kind)
        for kind in {each.kind for each in found if each.contacts}
    }


@pytest.mark.parametrize("blocks", [1, 2, 3, 1024])
def test_touch_may_begin_and_end_where_its_core_does_not(
    blocks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin.gestures.touches.MOST_BLOCKS", blocks)
    rows = "......", "......", "???...", "..#...", "..#...", "......"
    for some in (rows, rows[::-1], ("......", *rows), ("......", *rows[::-1])):
        found = verdicts(*some)
        assert found["tap"] is found["swipe"] is Verdict.POSSIBLE


def test_pause_is_shorter_where_the_first_tap_may_last() -> None:
    rows = "...", ".#.", ".?.", ".?.", "...", "...", ".#.", "..."
    assert verdicts(*rows)["double tap"] is Verdict.POSSIBLE
    assert "double tap" not in verdicts(*(row.replace("?", ".") for row in rows))


def test_two_fingers_may_begin_farther_apart_than_their_cores() -> None:
    wide = replace(TEMPLATES, span_m=9.0)
    rows = "........", "??....??", ".?#..#?.", "..#..#..", "..#..#..", "........"
    assert verdicts(*rows, templates=wide)["pinch"] is Verdict.POSSIBLE
    assert "pinch" not in verdicts(rows[0], *rows[2:], templates=wide)


def test_touch_may_have_been_in_a_bundle_that_it_meets_later() -> None:
    rows = ".......", "#.....?", "##....?", ".##...?", "..##..?", "...####", "......."
    assert verdicts(*rows)["swipe"] is Verdict.POSSIBLE
    assert verdicts(*(row.replace("?", ".") for row in rows)) == {"swipe": Verdict.CERTAIN}


def test_touch_that_merges_with_another_begins_with_the_first_of_both() -> None:
    rows = ".....", "#....", "#.#..", "####.", "..##.", "....."
    skin = Skin.grid(1, 5, pitch=1.0, area=1.0)
    for some in (rows, [row[::-1] for row in rows]):
        (found,) = find_gestures(*bounds(*some), skin, THRESHOLD, TEMPLATES)
        assert (found.begin, found.end) == ((10, 10), (40, 40))


def test_touches_may_be_one_before_the_record_and_after_it() -> None:
    skin = Skin.grid(1, 8, pitch=1.0, area=1.0)
    rows = "##....##", ".##...##", ".##...##", "..##..##", "........"
    for some in (rows, rows[::-1]):
        found = find_gestures(*bounds(*some), skin, THRESHOLD, TEMPLATES)
        alone = find_gestures(
            *bounds(*(f"{row[:4]}...." for row in some)), skin, THRESHOLD, TEMPLATES
        )
        # One finger moves too far to be still; the place of two together does not.
        assert "press" in {each.kind for each in found if each.contacts == (0,)}
        assert "press" not in {each.kind for each in alone}


def test_rotation_is_possible_where_its_angle_reaches_across_the_limit() -> None:
    skin = Skin.grid(3, 3, pitch=1.0, area=1.0)
    for last, verdict in (("#....#..?", Verdict.POSSIBLE), ("#....#..#", Verdict.CERTAIN)):
        rows = ".........", "#.#......", "#.#..#...", last, last, "........."
        found = find_gestures(*bounds(*rows), skin, THRESHOLD, TEMPLATES)
        assert [each.verdict for each in found.of("rotation")] == [verdict]
