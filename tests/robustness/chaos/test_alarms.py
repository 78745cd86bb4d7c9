"""The judge of alarms sees each thing that may be wrong."""

from __future__ import annotations

import pytest

from tests.robustness.chaos.alarms import Episode, deliveries_wrong, episodes_wrong
from tests.support.alarm_receiver import Taken

STORED = [(1, "defined", None, 1), (2, "raised", 7, 0), (3, "cleared", 7, 0), (4, "raised", 8, 0)]
GIVEN = [Taken(f"key-{number}", {"number": number}) for number in (2, 3, 3, 4)]
RAISED = [Episode(10, 20), Episode(30, 40), Episode(50, None)]


def test_all_that_is_right_is_right() -> None:
    assert deliveries_wrong(STORED, GIVEN) == []
    assert episodes_wrong("beat", RAISED, RAISED, 60) == []
    later = [*RAISED, Episode(70, 80)]
    assert episodes_wrong("beat", later[:2] + later[3:], RAISED[:2], 60) == [], "after the end"


@pytest.mark.parametrize(
    "given",
    [
        GIVEN[:-1],
        GIVEN[1:],
        [GIVEN[1], GIVEN[0], *GIVEN[2:]],
        [*GIVEN, Taken("other", {"number": 4})],
        [*GIVEN, Taken("key-4", {"number": 4, "more": 1})],
        [*GIVEN, Taken("key-5", {"number": 5})],
        [*GIVEN[:-1], Taken("key-3", {"number": 4})],
    ],
)
def test_wrong_delivery_is_seen(given: list[Taken]) -> None:
    assert deliveries_wrong(STORED, given) != []


def test_wrong_transitions_are_seen() -> None:
    doubled = [*STORED, (5, "raised", 8, 0)]
    assert deliveries_wrong(doubled, [*GIVEN, Taken("key-5", {"number": 5})]) != []


@pytest.mark.parametrize(
    "raised",
    [
        RAISED[1:],
        [*RAISED[:2], Episode(44, 46), RAISED[2]],
        [Episode(10, 32), *RAISED[1:]],
        [Episode(10, 20), Episode(12, 14), *RAISED[1:]],
    ],
)
def test_wrong_alarms_are_seen(raised: list[Episode]) -> None:
    assert episodes_wrong("beat", raised, RAISED, 60) != []
