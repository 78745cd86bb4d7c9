"""The explorer runs each schedule once, and leaves out only those that commute."""

from __future__ import annotations

from itertools import chain, pairwise, permutations, repeat
from math import comb
from typing import TYPE_CHECKING

import pytest

from tests.robustness.interleavings.explorer import NotReproducibleError, Replay, Sample, Search
from tests.robustness.interleavings.gate import find_shared
from tests.robustness.interleavings.scheduler import Execution, Taken
from tests.robustness.interleavings.steps import Step, read_statement

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tests.robustness.interleavings.scheduler import Chooser


def write(unit: str, table: str) -> Step:
    return Step(unit, table, writes=frozenset({table}))


def runner(*units: Sequence[Step]) -> Callable[[Chooser], Execution]:
    """Runs units whose steps never wait."""

    def run(chooser: Chooser) -> Execution:
        left = {steps[0].unit: list(steps) for steps in units}
        execution, last = Execution([]), None
        while waiting := {unit: steps[0] for unit, steps in left.items() if steps}:
            last = chooser.choose(waiting, last)
            if last is None:
                execution.complete = False
                break
            taken = Taken(left[last].pop(0), blocked=False, freed=())
            execution.taken.append(taken)
            chooser.took(taken)
        return execution

    return run


@pytest.mark.parametrize("sizes", [(1, 1), (2, 3), (4, 3), (2, 2, 2)])
def test_all_orders_of_dependent_steps_are_run(sizes: tuple[int, ...]) -> None:
    units = [[write(f"u{k}", "t") for _ in range(size)] for k, size in enumerate(sizes)]
    for search in (Search(None), Search(99)):
        found = [each.order for each in search.explore(runner(*units))]
        expected = set(permutations([f"u{k}" for k, size in enumerate(sizes) for _ in range(size)]))
        assert len(found) == len(set(found))
        assert set(found) == expected


def test_of_equal_schedules_one_is_run() -> None:
    apart = [[write(f"u{k}", f"t{k}") for _ in range(3)] for k in range(3)]
    assert len(list(Search(None).explore(runner(*apart)))) == 1
    # Two steps of each unit are dependent: the traces are the orders of these alone.
    mixed = [
        [write(f"u{k}", f"t{k}"), write(f"u{k}", "t"), write(f"u{k}", f"t{k}"), write(f"u{k}", "t")]
        for k in range(2)
    ]
    orders = [
        tuple(each.step.unit for each in execution.taken if each.step.text == "t")
        for execution in Search(None).explore(runner(*mixed))
    ]
    assert len(orders) == len(set(orders)) == comb(4, 2)


@pytest.mark.parametrize(("most", "count"), [(0, 2), (1, 2 + 2 * 2), (2, 2 + 4 + 8)])
def test_preemptions_are_bounded(most: int, count: int) -> None:
    units = [[write(f"u{k}", "t") for _ in range(3)] for k in range(2)]
    found = [each.order for each in Search(most).explore(runner(*units))]
    assert len(set(found)) == len(found) == count
    for order in found:
        switches = sum(a != b for a, b in pairwise(order))
        assert switches - 1 <= most


def test_sample_is_the_same_for_a_seed_and_ends() -> None:
    units = [[write(f"u{k}", "t") for _ in range(3)] for k in range(2)]
    found = [[each.order for each in Sample(5, 3).explore(runner(*units))] for _ in range(2)]
    assert found[0] == found[1]
    assert 10 <= len(set(found[0])) == len(found[0]) <= comb(6, 3)


def test_replay_runs_a_schedule_again() -> None:
    units = [[write(f"u{k}", "t") for _ in range(3)] for k in range(2)]
    order = ("u1", "u0", "u0", "u1", "u1", "u0")
    assert runner(*units)(Replay(order)).order == order
    with pytest.raises(NotReproducibleError):
        runner(*units)(Replay(("u0", "u0", "u0", "u0")))


@pytest.mark.parametrize("times", [1, 100])
def test_beginning_that_differs_is_run_again_and_an_error_if_it_always_does(times: int) -> None:
    same, other = ["t"] * 3, ["t", "other", "t"]
    steps = chain([same, same], [other] * times, repeat(same))

    def run(chooser: Chooser) -> Execution:
        tables = next(steps)
        units = [[write(f"u{k}", table) for table in tables] for k in range(2)]
        return runner(*units)(chooser)

    if times == 1:
        assert len(list(Search(None).explore(run))) == comb(6, 3)
        return
    with pytest.raises(NotReproducibleError):
        list(Search(None).explore(run))


def test_what_is_written_matters_to_others_from_the_commit_on() -> None:
    insert = read_statement("a", "INSERT INTO frames (slot) VALUES (1)")
    select = read_statement("b", "SELECT frames.t FROM frames WHERE frames.slot = 1")
    lock = read_statement("b", "SELECT feed.slot FROM feed ORDER BY feed.slot FOR UPDATE")
    commit = Step("a", "COMMIT", publishes=frozenset({"frames", "feed"}))
    assert insert.writes == {"frames"}
    assert select.reads == {"frames"}
    assert lock.writes == {"feed"}
    assert not insert.depends_on(select)
    assert commit.depends_on(select)
    assert lock.depends_on(commit)
    assert not lock.depends_on(select)
    assert insert.depends_on(read_statement("b", "DELETE FROM frames WHERE frames.slot = 1"))
    assert find_shared([insert, select, lock]) == {"frames"}
