from __future__ import annotations

from itertools import accumulate, pairwise, repeat
from typing import TYPE_CHECKING

from eskin_sensor_node.firmware.schedule import MOST_ROWS, Schedule
from hypothesis import given
from hypothesis import strategies as st

from tests.unit.sensor_node.designs import SECOND

if TYPE_CHECKING:
    from eskin_sensor_node.firmware.schedule import Frame

MS = SECOND // 1000
SCHEDULES = st.builds(
    Schedule,
    st.sampled_from([10_000, MS, 7 * MS, 300 * MS]),
    st.sampled_from([MS, 50 * MS, 333 * MS, 2 * SECOND]),
    st.sampled_from([1, 64, MOST_ROWS]),
    st.sampled_from([0, 1, 40, 4000]),
    st.sampled_from([SECOND, 605 * MS + 1]),
)


def frames(schedule: Schedule, count: int = 40) -> list[Frame]:
    following = accumulate(
        repeat(None, count), lambda frame, _: schedule.following(frame), initial=schedule.frame(0)
    )
    return list(following)


@given(SCHEDULES)
def test_frames_leave_out_no_sample(schedule: Schedule) -> None:
    for frame, after in pairwise(frames(schedule)):
        assert after.first == frame.first + frame.n
        assert frame.start == schedule.ticks(frame.first)
        assert schedule.ticks(frame.first + frame.n - 1) == frame.end - frame.dt
        assert 1 <= frame.n <= schedule.capacity
        assert frame.closes == (schedule.burst > 0 and after.first % schedule.burst == 0)
        assert after.start == frame.end or frame.closes


@given(SCHEDULES)
def test_frame_ends_with_its_stretch_or_its_burst(schedule: Schedule) -> None:
    for frame, after in pairwise(frames(schedule)):
        # It is due when its last sample is there, and before any of the next one is.
        assert frame.end - frame.dt < frame.due <= after.start + schedule.stretch
        begin, last = (ticks // schedule.stretch for ticks in (frame.start, frame.end - frame.dt))
        assert begin == last
        assert schedule.before(frame.start) == frame.first


@given(SCHEDULES, st.integers(0, 5), st.integers(0, 10**10))
def test_slower_rate_is_sampled_at_some_of_the_instants(
    schedule: Schedule, power: int, ticks: int
) -> None:
    fast = schedule.at_period(schedule.dt, ticks)
    slow = schedule.at_period(schedule.dt << power, ticks)
    assert slow.origin >= fast.origin >= ticks
    assert slow.origin % slow.dt == 0
    assert (slow.origin - fast.origin) % fast.dt == 0


def test_burst_is_4000_samples_at_100_khz_once_a_second() -> None:
    for frame in frames(Schedule(10_000, 50 * MS, MOST_ROWS, 4000, SECOND), 30):
        assert frame.dt == 10_000
        assert 0 <= frame.start - frame.trigger < 40 * MS
        assert frame.closes == (frame.end - frame.trigger == 40 * MS)
        assert frame.trigger % SECOND == 0
