from __future__ import annotations

from itertools import pairwise

from eskin_sensor_node.machine.schedule import build_schedule
from hypothesis import given
from hypothesis import strategies as st

from tests.unit.sensor_node.designs import SECOND, taxel


def test_continuous_frames_join_without_a_hole() -> None:
    schedule = build_schedule(taxel("capacitive"), 250)
    frames = [schedule.frame(number) for number in range(9)]
    assert all(a.end == b.start and a.first + a.n == b.first for a, b in pairwise(frames))
    assert frames[0].end == SECOND // 4


@given(
    st.sampled_from(["capacitive", "hybrid"]),
    st.integers(1, 300),
    st.lists(st.integers(0, 400), min_size=1, max_size=60),
)
def test_frames_that_are_cut_leave_out_no_sample(kind: str, block: int, cuts: list[int]) -> None:
    schedule = build_schedule(taxel(kind), block)
    frame = schedule.frame(0)
    for most in cuts:
        following = schedule.following(frame, most)
        assert following.first == frame.first + frame.n
        assert following.start == schedule.ticks(following.first)
        assert following.start == frame.end or frame.closes
        assert 1 <= following.n <= (most or block)
        assert following.closes == (
            schedule.frame(following.number).closes
            and following.end == schedule.frame(following.number).end
        )
        frame = following


@given(st.integers(1, 1000), st.integers(0, 400))
def test_burst_is_4000_samples_at_100_khz_once_a_second(block: int, number: int) -> None:
    schedule = build_schedule(taxel("hybrid"), block)
    frame = schedule.frame(number)
    assert schedule.ticks(frame.first) == frame.start
    assert schedule.ticks(frame.first + frame.n - 1) == frame.end - frame.dt
    assert frame.dt == 10_000
    assert 0 <= frame.start - frame.trigger < 40_000_000
    assert frame.closes == (frame.end - frame.trigger == 40_000_000)
    assert frame.trigger % SECOND == 0
