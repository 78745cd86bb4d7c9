"""Nodes that keep their bounds, drift, jump and lie: what messages prove of their clocks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_cloud.query.clock_check import ClockCheck
from eskin_sensor_node.firmware.clock import Clock
from eskin_sensor_node.firmware.message_writer import MessageWriter
from hypothesis import given, settings
from hypothesis import strategies as st

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MS = 1_000_000
SECOND = 1_000_000_000
START = 1_800_000_000 * SECOND
ERROR = 2 * MS  # of the node's real-time clock
DRIFT = 20_000  # of its crystal, in 1e-9
REFERENCE = 50 * MS  # of gateways' and clouds' clocks

SEEDS = st.integers(0, 2**32)


@dataclass
class Numbers:
    """Counts."""

    last: int = 0

    def next_sequence(self) -> int:
        self.last += 1
        return self.last


@dataclass
class Written:
    """A status, what its node stated, and when it was written and stored in truth."""

    true: int
    check: ClockCheck


@dataclass
class World:
    """One node, a gateway that acknowledges and a cloud that stores; every delay is drawn.

    Args:
        seed: Draws.
        ticks: The crystal's count by true ns since the start.
        reading_error: True error of the reading at the start, ns.
        gateway_error: True error of the gateway's clock, ns.
        cloud_error: True error of the cloud's clock, ns.
        longest: Longest delay of one way, ns.
    """

    seed: int
    ticks: Callable[[int], int]
    reading_error: int = 0
    gateway_error: int = 0
    cloud_error: int = 0
    longest: int = 100 * MS
    every: int = 5 * SECOND
    state: Callable[[tuple[int, int]], tuple[int, int]] = lambda stated: stated
    random: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.random = np.random.default_rng(self.seed)

    def delay(self) -> int:
        return int(self.longest * self.random.random() ** 3)

    def run(self, statuses: int) -> Iterator[Written]:
        clock = Clock(START + self.reading_error, ERROR, DRIFT)
        message_writer = MessageWriter(1, Numbers(), layout=bytes(32))
        arriving: list[tuple[int, int]] = []  # true instant of arrival, the gateway's time in it
        for number in range(statuses):
            now = number * self.every + int(self.random.integers(0, SECOND))
            for received_message, time in arriving:
                if received_message <= now:
                    message_writer.observe_time(time)
            arriving = [each for each in arriving if each[0] > now]
            stated = self.state(clock.enclosure(self.ticks(now)))
            at_gateway = now + self.delay()
            at_cloud = at_gateway + self.delay()
            arriving.append((at_gateway + self.delay(), START + at_gateway + self.gateway_error))
            stored = START + at_cloud + self.cloud_error
            yield Written(
                START + now, ClockCheck(stated, message_writer.gateway_time, stored, REFERENCE)
            )


def crystal(parts: float) -> Callable[[int], int]:
    """Counts with a rate error, in 1e-9."""
    return lambda true: true + int(true * parts / 1e9)


errors = st.integers(-REFERENCE, REFERENCE)


@given(
    SEEDS,
    st.integers(-ERROR, ERROR),
    st.floats(-DRIFT * 0.999, DRIFT * 0.999),
    errors,
    errors,
    st.sampled_from([0, MS, 100 * MS, 60 * SECOND, 86_400 * SECOND]),
)
def test_clock_within_its_bound_is_never_called_wrong(
    seed: int, reading: int, rate: float, gateway: int, cloud: int, longest: int
) -> None:
    world = World(seed, crystal(-rate), reading, gateway, cloud, longest)
    for written in world.run(20):
        assert written.check.verdict != "impossible"
        least, most = written.check.offset
        true = sum(written.check.stated) / 2 - written.true
        assert least is None or least <= true
        assert most is None or true <= most


@given(
    SEEDS,
    st.integers(-(10**12), 10**12),
    st.floats(-1e6, 1e6),
    errors,
    errors,
    st.integers(0, 10**11),
)
def test_certain_holds_whatever_the_node_s_clock_does(
    seed: int, reading: int, rate: float, gateway: int, cloud: int, width: int
) -> None:
    """Also where it lies: it states what it likes, as wide as it likes."""
    world = World(
        seed,
        crystal(rate),
        reading,
        gateway,
        cloud,
        state=lambda stated: (stated[0] - width, stated[1] + width),
    )
    for written in world.run(20):
        earliest, latest = written.check.stated
        if written.check.verdict == "certain":
            assert earliest <= written.true <= latest
        if written.check.verdict == "impossible":
            assert not earliest <= written.true <= latest


def test_certain_is_reached() -> None:
    world = World(1, crystal(0), longest=MS, state=lambda s: (s[0] - 6 * SECOND, s[1] + 6 * SECOND))
    assert [each.check.verdict for each in world.run(5)][1:] == ["certain"] * 4


SEEN = 2 * REFERENCE + 6 * SECOND + 300 * MS
"""Beyond what a node states, errors of this size show: two reference clocks, and a round."""


@given(SEEDS, st.sampled_from([-1, 1]), errors, errors)
@settings(max_examples=30)
def test_drift_beyond_the_bound_is_found_once_it_is_larger_than_what_is_proven(
    seed: int, side: int, gateway: int, cloud: int
) -> None:
    rate = side * 5_000_000  # 5 ms a second
    world = World(seed, crystal(rate), 0, gateway, cloud)
    for written in world.run(600):
        seconds = (written.true - START) / SECOND
        beyond = seconds * 5e-3 - seconds * DRIFT / 1e9 - ERROR / SECOND
        if beyond > SEEN / SECOND:
            assert written.check.verdict == "impossible"
    assert beyond > SEEN / SECOND


@given(SEEDS, st.sampled_from([-1, 1]), st.integers(SEEN + SECOND, 10**13), errors, errors)
def test_jump_is_found_by_the_next_status(
    seed: int, side: int, size: int, gateway: int, cloud: int
) -> None:
    def ticks(true: int) -> int:
        return true + (side * size if true > 50 * SECOND else 0)

    verdicts = [w.check.verdict for w in World(seed, ticks, 0, gateway, cloud).run(20)]
    assert verdicts[:10] == ["possible"] * 10
    assert verdicts[11:] == ["impossible"] * 9


@given(SEEDS, st.integers(SEEN + SECOND, 10**13), errors, errors)
def test_lie_about_the_future_is_found_without_the_node_s_help(
    seed: int, size: int, gateway: int, cloud: int
) -> None:
    world = World(seed, crystal(0), 0, gateway, cloud, state=lambda s: (s[0] + size, s[1] + size))
    for written in world.run(5):
        alone = ClockCheck(written.check.stated, None, written.check.before, REFERENCE)
        assert alone.verdict == "impossible"


def test_lie_about_the_past_without_a_gateway_s_time_is_only_possible() -> None:
    """It cannot be distinguished from a message that waited in flash; the page says so."""
    world = World(1, crystal(0), state=lambda s: (s[0] - 3600 * SECOND, s[1] - 3600 * SECOND))
    for written in world.run(5):
        alone = ClockCheck(written.check.stated, None, written.check.before, REFERENCE)
        assert alone.verdict == "possible"
        assert alone.offset[1] is None


@pytest.mark.parametrize("ahead", [SECOND, 3600 * SECOND])
def test_reference_clocks_that_contradict_each_other_judge_no_node(ahead: int) -> None:
    checks = [w.check for w in World(1, crystal(0), gateway_error=ahead + 6 * SECOND).run(20)]
    assert not any(check.references_agree for check in checks[1:])
    assert {check.verdict for check in checks} == {"possible"}
    assert {check.offset for check in checks[1:]} == {(None, None)}


@given(SEEDS, SEEDS, st.integers(-ERROR, ERROR), st.integers(-ERROR, ERROR))
def test_order_of_two_nodes_instants_is_true_where_enclosures_say_it(
    one: int, other: int, first: int, second: int
) -> None:
    rates = np.random.default_rng(one).uniform(-0.999 * DRIFT, 0.999 * DRIFT, 2)
    worlds = World(one, crystal(rates[0]), first), World(other, crystal(rates[1]), second)
    for a, b in zip(*(world.run(20) for world in worlds), strict=True):
        if a.check.stated[1] < b.check.stated[0]:
            assert a.true < b.true
