"""Interrupts after each sample or after a frame: the same messages, at another price."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import pytest
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.machine.ledger import INTERRUPT_NS, WAKE_NS
from eskin_sensor_node.machine.power.loads import Loads, bounds
from eskin_sensor_node.machine.prices import PRICES
from eskin_sensor_node.machine.sampling import most_latency, require_depth
from eskin_sensor_node.settings import EnergySection

from eskin.errors import SettingsError
from tests.unit.sensor_node.designs import SECOND, Bench, settings

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.machine.work_counters import WorkCounters

FRAME, SAMPLES = 0, 3 * 2000


class Life(NamedTuple):
    bodies: list[bytes]
    work: WorkCounters
    latencies: list[tuple[int, int]]


def lived(folder: Path, depth: int) -> Life:
    """Two seconds of three taxels with 1000 samples a second, in frames of 50."""
    folder.mkdir()
    bench = Bench(folder, machine={"dma_samples": depth})
    bench.run_to(2.0)
    life = Life(
        list(bench.bodies()),
        bench.node.machine.ledger.take(2 * SECOND),
        bench.node.sampling.latencies,
    )
    bench.close()
    return life


@pytest.fixture(scope="module")
def lives(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Life]:
    folder = tmp_path_factory.mktemp("sampling")
    return {depth: lived(folder / str(depth), depth) for depth in (FRAME, 1, 7)}


def test_messages_are_the_same_bytes_whatever_the_depth(lives: dict[int, Life]) -> None:
    assert len(lives[FRAME].bodies) > 40
    assert lives[1].bodies == lives[7].bodies == lives[FRAME].bodies


def test_each_interrupt_is_counted_with_its_cycles_and_its_wake_up(
    lives: dict[int, Life],
) -> None:
    frame, each, seven = (lives[depth].work for depth in (FRAME, 1, 7))
    assert (frame.wakes, each.wakes, seven.wakes) == (3 * 40, SAMPLES, 3 * 40 * 8)
    assert each.conversions == frame.conversions
    more = SAMPLES - 3 * 40
    cost = PRICES["interrupt"]
    assert each.cycles - frame.cycles == more * cost.most
    assert each.fewest - frame.fewest == more * cost.least
    assert frame.asleep - each.asleep == more * (WAKE_NS + INTERRUPT_NS)


def test_an_interrupt_each_sample_certainly_costs_more_energy(lives: dict[int, Life]) -> None:
    section = EnergySection()
    less, more = (bounds(section, lives[depth].work) for depth in (FRAME, 1))
    assert float(less["waking"].sup) < float(more["waking"].inf)
    for seed in range(20):
        loads = Loads(section, ColumnGenerator(seed, 0))
        costs = [sum(loads.costs(lives[depth].work)) for depth in (FRAME, 7, 1)]
        assert costs == sorted(costs)
        true = loads.costs(lives[1].work)
        assert more["waking"].contains(true.waking)


@pytest.mark.parametrize("depth", [FRAME, 1, 7])
def test_jitter_stays_within_its_bound(lives: dict[int, Life], depth: int) -> None:
    # Three taxels ask at one instant: one is served at once, the last one after the others.
    least = min(least for least, _ in lives[depth].latencies)
    most = max(most for _, most in lives[depth].latencies)
    assert (least, most) == (WAKE_NS, most_latency(3))
    for low, high in lives[depth].latencies:
        assert high - low <= most_latency(3) - WAKE_NS < SECOND // 1000


def test_stopped_sampling_wakes_no_processor(tmp_path: Path) -> None:
    bench = Bench(tmp_path, machine={"dma_samples": 1})
    bench.run_to(1.13)
    bench.node.shed("ordered")
    bench.node.machine.ledger.take(bench.ticks)
    bench.run_to(5.13)
    assert bench.node.machine.ledger.take(bench.ticks).wakes == 0
    bench.node.resume()
    bench.run_to(6.13)
    # From the next whole frame on.
    assert bench.node.machine.ledger.take(bench.ticks).wakes == 3 * 980
    bench.close()


def test_buffer_that_would_overflow_before_the_processor_comes_is_refused(tmp_path: Path) -> None:
    # A burst has a code every 10 us, and waking takes 20.
    with pytest.raises(SettingsError, match=r"machine.dma_samples.*t02.*10000 ns.*at least 3"):
        require_depth(settings(tmp_path, "forearm", machine={"dma_samples": 2}))
    for depth in (3, FRAME):
        require_depth(settings(tmp_path, "forearm", machine={"dma_samples": depth}))
