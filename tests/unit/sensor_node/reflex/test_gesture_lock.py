"""A gesture lock opens only where the true word is its sequence, whatever the truth was."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Final

import pytest
from eskin_sensor_node.firmware.gesture_lock import (
    COMPLETE,
    EXPIRED,
    RELEASED,
    WAITING,
    WRONG,
    GestureLock,
)
from eskin_sensor_node.firmware.monitor import CERTAIN, IMPOSSIBLE, POSSIBLE
from hypothesis import given, settings
from hypothesis import strategies as st

if TYPE_CHECKING:
    from collections.abc import Sequence

GESTURES: Final = "abc"
SEQUENCE: Final = "aba"
TIMEOUT: Final = 1000
LOCKOUT: Final = 500


def lock(attempts: int = 3) -> GestureLock:
    return GestureLock(GESTURES, SEQUENCE, timeout=TIMEOUT, attempts=attempts, lockout=LOCKOUT)


def word(truths: Sequence[frozenset[str]]) -> str:
    """The gestures that hold, one after the other; empty where two hold at once."""
    if any(len(each) > 1 for each in truths):
        return ""
    held = ["".join(each) for each in truths if each]
    return "".join(name for name, _ in groupby(held))


TRUTHS = st.lists(st.sampled_from(["", "", "", *GESTURES]).map(frozenset), max_size=40)


def enter(made: GestureLock, begin: int, verdicts: Sequence[dict[str, int]]) -> int | None:
    """Take verdicts until an entry is complete; gives after how many."""
    for k, each in enumerate(verdicts):
        made.take(begin + k, each)
        if made.outcome == COMPLETE:
            made.judge(begin + k)
            return k
    return None


OPEN = st.sampled_from([(True, True)] * 4 + [(False, False), (True, False)])
"""Whether a gesture is true, and whether that is known for certain."""
EXTRA = st.none() | st.tuples(st.sampled_from(GESTURES), st.integers(1, 2), OPEN)


@settings(max_examples=300)
@given(
    st.lists(EXTRA, min_size=3, max_size=3),
    st.lists(OPEN, min_size=3, max_size=3),
)
def test_what_unlocks_is_the_true_word(
    between: list[tuple[str, int, tuple[bool, bool]] | None], known: list[tuple[bool, bool]]
) -> None:
    """The sequence is entered with something else between, and each part may be open."""
    truths: list[frozenset[str]] = []
    verdicts: list[dict[str, int]] = []

    def add(name: str, n: int, found: tuple[bool, bool]) -> None:
        is_true, is_known = found
        rest = dict.fromkeys(GESTURES, IMPOSSIBLE)
        verdict = POSSIBLE if not is_known else CERTAIN if is_true else IMPOSSIBLE
        truths.extend([frozenset(), *[frozenset([name] if is_true else [])] * n])
        verdicts.extend([rest, *[rest | {name: verdict}] * n])

    for letter, own, extra in zip(SEQUENCE, known, between, strict=True):
        if extra is not None:
            add(*extra)
        add(letter, 1, own)
    made = lock()
    made.challenge(0)
    end = enter(made, 0, verdicts)
    if made.outcome == RELEASED:
        assert end is not None
        rests = [k for k in range(end) if not truths[k]]
        assert any(word(truths[k : end + 1]) == SEQUENCE for k in rests)


@given(TRUTHS)
def test_what_is_certain_throughout_unlocks(truths: list[frozenset[str]]) -> None:
    truths = [frozenset(), *truths]
    verdicts = [
        {name: CERTAIN if name in truth else IMPOSSIBLE for name in GESTURES} for truth in truths
    ]
    made = lock()
    made.challenge(0)
    enter(made, 0, verdicts)
    known = word(truths)
    expected = WAITING if len(known) < 3 else RELEASED if known[:3] == SEQUENCE else WRONG
    assert made.outcome == expected
    assert made.failures == (expected == WRONG)


def typed(letters: str) -> list[dict[str, int]]:
    """Verdicts of gestures that are entered one by one; a dot is a rest, a capital possible."""
    return [
        {
            name: CERTAIN if name == each else POSSIBLE if name.upper() == each else IMPOSSIBLE
            for name in GESTURES
        }
        for each in letters
    ]


@pytest.mark.parametrize(
    ("letters", "outcome", "unclear"),
    [
        (".a.b.a", RELEASED, 0),
        (".aaa..bbb.a", RELEASED, 0),
        (".AaA.BbB.Aa", RELEASED, 0),
        (".aAa.b.a", RELEASED, 0),  # again before another one: counted once, whatever is true
        ("aa.a.b.a", RELEASED, 0),  # what holds at the challenge is not entered
        (".a.b.c", WRONG, 0),
        (".a.C.b.a", WAITING, 1),  # c may have been entered
        (".a.C.a.b.a", RELEASED, 1),  # and so it begins again
        (".a.b.A", WAITING, 0),
    ],
)
def test_entries(letters: str, outcome: int, unclear: int) -> None:
    made = lock()
    made.challenge(0)
    enter(made, 0, typed(letters))
    assert (made.outcome, made.unclear) == (outcome, unclear)


def test_two_at_once_are_unclear() -> None:
    made = lock()
    made.challenge(0)
    both = {"a": CERTAIN, "b": POSSIBLE, "c": IMPOSSIBLE}
    assert enter(made, 0, [*typed(".a."), both, *typed("b.a")]) is None
    assert (made.outcome, made.unclear) == (WAITING, 1)


def test_wrong_entries_lock_it_and_a_right_one_starts_the_count_anew() -> None:
    made, now = lock(attempts=2), 0
    for letters, failures in ((".c.b.a", 1), (".a.b.a", 0), (".c.b.a", 1), (".b.c.a", 2)):
        assert made.locked(now) == 0
        made.challenge(now)
        enter(made, now, typed(letters))
        assert made.failures == failures
        now += 10
    assert 0 < made.locked(now) <= LOCKOUT
    now += LOCKOUT
    assert made.locked(now) == 0
    # One more wrong entry locks it again.
    made.challenge(now)
    enter(made, now, typed(".c.b.a"))
    assert made.locked(now + 10) > 0


def test_an_entry_that_takes_too_long_counts_once_it_was_begun() -> None:
    made = lock()
    made.challenge(0)
    made.take(TIMEOUT, typed(".")[0])
    assert (made.outcome, made.failures) == (EXPIRED, 0)
    made.challenge(2000)
    enter(made, 2000, typed(".a.b"))
    made.take(2000 + TIMEOUT, typed(".")[0])
    assert (made.outcome, made.failures) == (EXPIRED, 1)


def test_a_start_keeps_the_count_and_begins_the_wait_again() -> None:
    made = lock()
    made.restore(3, 70)
    assert made.locked(70) == LOCKOUT
    assert made.failures == 3
    made = lock()
    made.restore(2, 70)
    assert made.locked(70) == 0


def test_an_entry_is_counted_before_it_is_judged() -> None:
    made = lock()
    made.challenge(0)
    for k, each in enumerate(typed(".a.b.a")):
        made.take(k, each)
    assert (made.outcome, made.failures, made.changed) == (COMPLETE, 1, True)
    made.refuse(9)
    assert (made.outcome, made.failures) == (WRONG, 1)
