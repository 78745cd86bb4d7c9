"""What a gateway remembers of a node, through its spool and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_gateway.spool.batch import Batch
from eskin_gateway.spool.node_state import NodeState

from eskin.wire.messages import Position
from tests.unit.gateway.test_spool import opened

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_gateway.spool.spool import Spool


@pytest.fixture
def spool(tmp_path: Path) -> Iterator[Spool]:
    made = opened(tmp_path)
    yield made
    made.close()


def test_holes_close_when_the_node_holds_nothing_there(spool: Spool) -> None:
    state = NodeState()
    for boot in (1, 2, 3):
        for number in range(0, 100, 2):
            state.add(Position(boot, number))
    state.release(Position(3, 90))
    state.release(Position(2, 5))
    spool.commit(Batch(nodes={"n": state}))
    kept = spool.node("n")
    assert kept is not None
    assert {boot: list(ranges) for boot, ranges in kept.ranges.items()} == {
        1: [(0, 98)],
        2: [(0, 98)],
        3: [(90, 90), (92, 92), (94, 94), (96, 96), (98, 98)],
    }
    assert kept.is_duplicate(Position(1, 1))
    assert kept.is_duplicate(Position(3, 89))
    assert not kept.is_duplicate(Position(3, 91))


def test_unknown_lower_boot_is_no_duplicate(spool: Spool) -> None:
    state = NodeState()
    state.release(Position(9, 4))
    for number in (5, 3):
        assert not state.is_duplicate(Position(7, number))
        state.add(Position(7, number))
        state.release(Position(7, 0))
    spool.commit(Batch(nodes={"n": state}))
    kept = spool.node("n")
    assert kept is not None
    assert [number for number in range(7) if kept.is_duplicate(Position(7, number))] == [3, 5]
    kept.release(Position(10, 0))
    assert [number for number in range(7) if kept.is_duplicate(Position(7, number))] == list(
        range(6)
    )
    assert kept.is_duplicate(Position(9, 3)), "that was below what the node held"


def test_boot_in_use_is_not_dropped_for_higher_ones(spool: Spool) -> None:
    state = NodeState()
    for boot in range(100, 140):
        state.add(Position(boot, 0))
    state.release(Position(120, 0))
    for number in range(5):
        state.add(Position(7, number))
        spool.commit(Batch(nodes={"n": state}))
        kept = spool.node("n")
        assert kept is not None
        assert all(kept.is_duplicate(Position(7, k)) for k in range(number + 1))
        state = kept


@pytest.mark.parametrize("held", [Position(0, 0), Position(3000, 0)])
def test_state_of_a_node_is_bounded(spool: Spool, held: Position) -> None:
    state = NodeState()
    state.release(held)
    for number in range(0, 20_000, 2):
        state.add(Position(1, number))
    for boot in range(2, 2000):
        state.add(Position(boot, 0))
    spool.commit(Batch(nodes={"n": state}))
    assert len(state.encode_ranges()) < 50_000
    assert state.is_duplicate(Position(1999, 0))


def test_ranges_of_all_boots_are_bounded(
    spool: Spool,
) -> None:
    state = NodeState()
    for boot in (1, 2, 3, 4, 2):
        for number in range(0, 4000, 2):
            state.add(Position(boot, number))
    spool.commit(Batch(nodes={"n": state}))
    kept = spool.node("n")
    assert kept is not None
    assert {boot: len(ranges) for boot, ranges in kept.ranges.items()} == {3: 96, 4: 2000, 2: 2000}
    kept.release(Position(9, 0))
    assert all(kept.is_duplicate(Position(boot, 3999 - 1)) for boot in (2, 3, 4))
