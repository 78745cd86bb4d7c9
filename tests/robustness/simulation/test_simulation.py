"""Laws of delivery hold under any faults of a seed, which decides all that happens."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from typing import TYPE_CHECKING, Final

import pytest
from eskin_gateway.spool.node_state import NodeState

from tests.robustness.simulation.faults import KINDS, plan
from tests.robustness.simulation.parties import Parties
from tests.robustness.simulation.shrink import shrink
from tests.robustness.simulation.world import simulate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tests.robustness.simulation.faults import Fault

SEEDS: Final = range(1, 101)
COUNT: Final = 8
CHUNK: Final = 10
FOUND: Final = [
    # Two gateways encrypted a message under random keys, as its subject was erased, and the cloud,
    # which was away then, got both before it heard of the erasure.
    (40603, 12, {0, 1, 2, 4, 6, 7, 9, 10, 11}),
]
"""Seeds, counts and numbers of faults."""


@pytest.fixture(scope="module")
def parties() -> Iterator[Parties]:
    with Parties() as made:
        yield made


@pytest.mark.schedules
@pytest.mark.parametrize("first", SEEDS[::CHUNK])
def test_laws_of_delivery_hold(first: int, parties: Parties) -> None:
    for seed in range(first, first + CHUNK):
        run = simulate(seed, plan(seed, COUNT), parties)
        assert run.broken is None, f"seed {seed}: {run.broken}"
        assert run.messages > 20


@pytest.mark.parametrize(("seed", "count", "numbers"), FOUND)
def test_faults_that_broke_a_law_once_do_so_no_more(
    seed: int, count: int, numbers: set[int], parties: Parties
) -> None:
    faults = [each for each in plan(seed, count) if each.number in numbers]
    assert simulate(seed, faults, parties).broken is None


def test_seeds_draw_each_kind_of_fault() -> None:
    drawn = {(each.part, each.kind) for seed in SEEDS for each in plan(seed, COUNT)}
    assert drawn == set(KINDS)


@pytest.mark.nightly
def test_same_seed_is_the_same_history_in_another_process() -> None:
    histories = set()
    for hash_seed in ("1", "2"):
        command = [sys.executable, "-m", "tests.robustness.simulation", "--seed", "3"]
        environment = os.environ | {"PYTHONHASHSEED": hash_seed}
        done = subprocess.run(command, env=environment, capture_output=True, check=True)
        histories.add(done.stdout)
    assert len(histories) == 1
    assert b"all rest: " in histories.pop()


@pytest.mark.nightly
def test_bug_is_found_and_shrinks(parties: Parties, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NodeState, "is_duplicate", lambda *_: False)

    def fails(seed: int, some: Sequence[Fault]) -> bool:
        return simulate(seed, some, parties).broken is not None

    seed = next(seed for seed in range(1, 30) if fails(seed, plan(seed, COUNT)))
    few = shrink(plan(seed, COUNT), partial(fails, seed))
    assert len(few) <= 3
    assert fails(seed, few)


@pytest.mark.parametrize("needed", [set(), {0}, {7}, {2, 5}, {0, 3, 4, 7}, set(range(8))])
def test_shrinker_keeps_the_fewest_faults_that_fail(needed: set[int]) -> None:
    few = shrink(plan(1, 8), lambda some: needed <= {each.number for each in some})
    assert {each.number for each in few} == needed
