"""The emulated air: never faster than its bandwidth, and what it loses comes again."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.machine.radio import Radio
from eskin_sensor_node.settings import RadioSection
from hypothesis import given
from hypothesis import strategies as st

from tests.contract.micropython.delivery import Delivery
from tests.unit.sensor_node.traffic import Traffic

if TYPE_CHECKING:
    from eskin_sensor_node.firmware.chip import Position

SECOND = 1_000_000_000
SIZES = st.lists(st.tuples(st.integers(1, 5000), st.integers(0, 3 * SECOND)), max_size=30)


class Air:
    """A radio whose time the test turns."""

    def __init__(self, *, seed: int = 1, **given: Any) -> None:
        self.now = 0
        self.traffic = Traffic()
        self.radio = Radio(
            RadioSection(**given),
            now=lambda: self.now,
            random=np.random.default_rng(seed),
            meter=self.traffic,
        )


@given(SIZES, st.integers(1, 20_000), st.sampled_from([0.0, 0.3]))
def test_throughput_never_exceeds_the_bandwidth(
    said: list[tuple[int, int]], bandwidth: int, loss: float
) -> None:
    air = Air(bandwidth_bytes_per_s=bandwidth, loss=loss)
    begun = ended = 0
    for size, pause in said:
        before = air.traffic.sent
        end, _ = air.radio.send(size)
        # A message takes its time on the air, behind the one before.
        begun = max(ended, air.now)
        assert (end - begun) * bandwidth >= (air.traffic.sent - before) * SECOND
        assert air.traffic.sent * SECOND <= bandwidth * end
        assert air.radio.is_free((end - air.now) / SECOND)
        assert not air.radio.is_free((end - air.now - 1) / SECOND)
        ended = end
        air.now += pause


def test_without_bandwidth_a_message_is_over_at_once() -> None:
    air = Air()
    air.now = 77
    assert air.radio.send(10**6) == (77, True)
    assert air.radio.is_free()
    assert air.traffic.sent == 10**6


def test_same_seed_loses_the_same_packets_whatever_is_in_them() -> None:
    fates = []
    for seed, size in ((1, 100), (1, 90), (2, 100)):
        air = Air(seed=seed, loss=0.3, tries=1)
        fates.append([air.radio.send(size)[1] for _ in range(300)])
    assert fates[0] == fates[1]
    assert fates[0] != fates[2]
    assert 60 <= fates[0].count(False) <= 120


@pytest.mark.parametrize("tries", [1, 2, 4])
def test_repeats_cost_bytes_and_leave_fewer_messages_lost(tries: int) -> None:
    air = Air(loss=0.3, packet_bytes=100, tries=tries)
    lost = sum(not air.radio.send(100)[1] for _ in range(20_000))
    # A geometric series that ends with the last try.
    assert lost / 20_000 == pytest.approx(0.3**tries, rel=0.15)
    assert air.traffic.sent / 2e6 == pytest.approx((1 - 0.3**tries) / 0.7, rel=0.03)


def test_message_is_given_up_with_its_first_hopeless_packet() -> None:
    air = Air(loss=0.999999, packet_bytes=100, tries=3)
    assert air.radio.send(1000)[1] is False
    assert air.traffic.sent == 300


def test_all_arrives_exactly_once_over_a_lossy_narrow_air() -> None:
    air = Air(bandwidth_bytes_per_s=4000, loss=0.3, packet_bytes=256, tries=2)
    node = Delivery(10**6, 16, 2 * SECOND, 60 * SECOND, "5a" * 32)
    for _ in range(40):
        node.say(["frame", 240], ["statements", 0])
    node.connect()
    received_messages: Counter[Position] = Counter()
    on_air: list[tuple[int, bool, Position]] = []
    sends = 0
    while node.outbox.messages:
        while air.radio.is_free(0.2) and (due := node.send(1)):
            position = due[0][0][0], due[0][0][1]
            on_air.append((*air.radio.send(len(due[0][2]) // 2), position))
            sends += 1
        for end, arrives, position in [each for each in on_air if each[0] <= air.now]:
            on_air.remove((end, arrives, position))
            node.leave(position[0], position[1], position[1])
            if arrives:
                received_messages[position] += 1
                node.acknowledge([*position, position[1]])
        assert air.traffic.sent * SECOND <= 4000 * (air.now + SECOND)
        air.now += SECOND // 10
        node.now = air.now
    assert received_messages == {(1, n): 1 for n in range(80)}
    # Some were lost on the air, and were sent again by the outbox.
    assert sends > 85
