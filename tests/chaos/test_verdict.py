"""The verdict sees what is wrong: gaps without a cause, sums that are none, numbers with holes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from cloud.store import Store
from cloud.store.packing import pack_some
from eskin.messages import Encoding
from tests.chaos.plan import Stroke
from tests.chaos.verdict import Verdict, add_up, explain
from tests.cloud.clouds import put
from tests.cloud.messages import CHANNEL, DT, NODE, START, block, gap
from tests.files import ask

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin.messages import Gap


@pytest.fixture
def burnt(tmp_path: Path) -> Iterator[Store]:
    with Store(tmp_path / "store.sqlite") as store:
        put(store, block(0), block(1), naming(2))
        yield store


def naming(sequence: int, *lost: tuple[int, int, int]) -> Gap:
    """A gap that names messages."""
    return replace(gap(sequence), lost=lost)


def wrong(store: Store, *faults: str) -> list[str]:
    verdict = Verdict()
    explain(store.place, verdict, set(faults))
    add_up(store.place, verdict)
    return verdict.faults


def test_gap_needs_a_cause(burnt: Store) -> None:
    assert wrong(burnt, "cut") == []
    assert wrong(burnt, "clock ahead") == ["1 gaps without a cause: flash full"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("DELETE FROM blocks WHERE sequence = 1", "1 and"),
        ("UPDATE channels SET samples = samples + 1", "are stored"),
        ("UPDATE sequences SET first = 1", "holes: 1 ranges from 1"),
        ("INSERT INTO sequences SELECT node, boot, 9, 9 FROM sequences", "holes: 2 ranges"),
    ],
)
def test_sums_must_be_those_of_the_blocks(burnt: Store, change: str, words: str) -> None:
    burnt.write(lambda connection: connection.exec_driver_sql(change)).result(20)
    (fault,) = wrong(burnt, "cut")
    assert words in fault


def test_hole_that_a_gap_names_is_none(burnt: Store) -> None:
    put(burnt, block(5))
    (fault,) = wrong(burnt, "cut")
    assert "holes: 2 ranges from 0" in fault
    put(burnt, naming(6, (1, 3, 4)))
    assert wrong(burnt, "cut") == []


def test_packed_blocks_are_counted_one_by_one(tmp_path: Path) -> None:
    span, ones = 100 * DT, [1.0] * 100
    path = tmp_path / "store.sqlite"
    with Store(path) as store:
        for number in range(30):
            time = START + number * span
            put(store, block(number, ones, ones, time=(time, time), encoding=Encoding.Q16))
        pack_some(store, (NODE, CHANNEL), 0)
        assert ask(path, "SELECT count(*), max(packed) FROM blocks") == [(10, 21)]
        assert wrong(store) == []


def test_stroke_reads_well() -> None:
    assert str(Stroke("cut", "cloud", 1.0, 3.5)) == "    1.0 s  cut cloud for 2.5 s"
