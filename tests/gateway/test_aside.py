"""What the cloud fails at is left out only while it takes others, and is tried again."""

from __future__ import annotations

import pytest

from gateway.aside import Aside
from gateway.spool import Stored

ONE, TWO = (Stored(number, "fingertip", 1, b"x") for number in (1, 2))


@pytest.fixture
def now() -> list[float]:
    return [100.0]


@pytest.fixture
def aside(now: list[float]) -> Aside:
    return Aside(lambda: now[0])


def test_suspect_is_left_out_and_tried_again_at_once_when_another_was_taken(aside: Aside) -> None:
    assert aside.fault is None
    assert aside.hold(ONE)
    assert (aside.ids, aside.due()) == ((1,), None)
    aside.taken([TWO])
    assert aside.due() == ONE
    assert "1 message(s), one of fingertip" in str(aside.fault)
    aside.taken([ONE])
    assert (aside.ids, aside.due(), aside.fault) == ((), None, None)


def test_pauses_grow_up_to_a_minute(aside: Aside, now: list[float]) -> None:
    aside.hold(ONE)
    aside.taken([TWO])
    for pause in (2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0):
        aside.hold(ONE)
        now[0] += pause - 0.01
        assert aside.due() is None
        now[0] += 0.01
        assert aside.due() == ONE


def test_pause_is_no_longer_after_days(aside: Aside, now: list[float]) -> None:
    aside.hold(ONE)
    aside.taken([TWO])
    for _ in range(3000):
        assert aside.due() == ONE
        aside.hold(ONE)
        assert aside.due() is None
        now[0] += 60.0
    assert aside.due() == ONE


def test_one_that_fails_otherwise_is_put_off_too(aside: Aside, now: list[float]) -> None:
    aside.put_off(ONE)
    aside.hold(ONE)
    aside.put_off(ONE)
    assert aside.due() is None
    aside.taken([TWO])
    aside.put_off(ONE)
    assert aside.due() is None
    now[0] += 2.0
    assert aside.due() == ONE
    aside.forget(ONE)
    assert (aside.ids, aside.due()) == ((), None)


def test_those_that_are_held_take_turns(aside: Aside, now: list[float]) -> None:
    aside.hold(ONE)
    aside.hold(TWO)
    aside.taken([])
    for message in (ONE, TWO, ONE, TWO):
        assert aside.due() == message
        aside.hold(message)
        now[0] += 60.0


def test_when_nothing_tells_whose_fault_it_is_none_is_left_out(aside: Aside) -> None:
    aside.hold(ONE)
    aside.taken([])
    aside.hold(TWO)
    assert aside.release_suspects()
    assert aside.ids == (1,)
    assert not aside.release_suspects()


def test_so_many_failures_one_after_another_are_the_clouds(aside: Aside) -> None:
    for number in range(16):
        assert aside.hold(Stored(number, "n", 1, b""))
    assert not aside.hold(Stored(16, "n", 1, b""))
    assert len(aside) == 16
