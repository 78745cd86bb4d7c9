"""The verdict sees what is wrong: gaps without a cause, sums that are none, numbers with holes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.store import Store

from eskin.wire.messages import Position
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.timestamp import SECOND
from tests.robustness.chaos.plan import Blow, Stroke
from tests.robustness.chaos.verdict import Verdict, add_up, explain, left_out
from tests.support.skin_watcher import Seen
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import NODE, START, gap, stretch

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin.wire.frames import Statements


@pytest.fixture
def burnt(tmp_path: Path) -> Iterator[Store]:
    with Store(tmp_path / "store.sqlite") as store:
        put(store, stretch(0), stretch(1), naming(2))
        yield store


def naming(sequence: int, *lost: tuple[int, int, int]) -> Statements:
    """A gap that names messages."""
    return gap(sequence, lost=lost)


def blow(fault: str, part: str, begin: float = 0.0, end: float = 5.0) -> Blow:
    """A stroke, in seconds after the first sample."""
    return Blow(fault, part, START + round(begin * SECOND), START + round(end * SECOND))


CUT = blow("cut", "cloud")


def wrong(store: Store, *blows: Blow) -> list[str]:
    verdict = Verdict()
    explain(store.location, verdict, blows)
    add_up(store.location, verdict)
    return verdict.faults


def test_gap_needs_a_cause(burnt: Store) -> None:
    assert wrong(burnt, CUT) == []
    (fault,) = wrong(burnt, replace(CUT, fault="clock ahead"))
    assert fault == f"{NODE}: gap without a cause, from 0.0 to 0.0 s: flash full"
    (fault,) = wrong(burnt)
    assert "gap without a cause" in fault


@pytest.mark.parametrize("part", [NODE, "broker", "gateway-2", "cloud", "database"])
def test_full_flash_is_explained_by_its_node_and_by_what_is_behind_it(
    burnt: Store, part: str
) -> None:
    assert wrong(burnt, replace(CUT, part=part)) == []


@pytest.mark.parametrize("hour", [-3600.0, 3600.0])
def test_gap_of_a_node_whose_clock_was_an_hour_off_is_explained(burnt: Store, hour: float) -> None:
    assert wrong(burnt, blow("cut", "cloud", hour, hour + 5.0)) == []
    (fault,) = wrong(burnt, blow("cut", "cloud", hour - 500.0, hour - 400.0))
    assert "gap without a cause" in fault


def test_fault_of_another_node_explains_nothing(burnt: Store) -> None:
    (fault,) = wrong(burnt, replace(CUT, part="palm"))
    assert "gap without a cause" in fault


@pytest.mark.parametrize(
    ("begin", "unexplained"), [(-200.0, 1), (-80.0, 0), (-1.0, 0), (1.0, 0), (4.0, 1)]
)
def test_fault_explains_what_is_lost_from_its_begin_until_all_has_drained(
    burnt: Store, begin: float, unexplained: int
) -> None:
    found = wrong(burnt, blow("cut", "cloud", begin, begin + 5.0))
    assert len(found) == unexplained, found


@pytest.mark.parametrize(
    ("reason", "cause", "others"),
    [
        ("sampling overrun", "hang", ("cut", "kill")),
        ("flash write failed", "disk full", ("hang", "cut")),
    ],
)
def test_what_a_node_does_by_itself_is_explained_by_its_own_faults_alone(
    tmp_path: Path, reason: str, cause: str, others: tuple[str, ...]
) -> None:
    with Store(tmp_path / "store.sqlite") as store:
        time = (START + 10 * SECOND, START + 12 * SECOND)
        said = gap(1, time=time, lost=())
        (stated,) = said.gaps
        stated = stated._replace(reason=reason, messages=0)
        put(store, stretch(0), replace(said, gaps=(stated,)))
        own = blow(cause, NODE, 9.0, 12.0)
        assert wrong(store, own) == []
        early, late = blow(cause, NODE, 1.0, 7.0), blow(cause, NODE, 15.0, 16.0)
        wrongly = [replace(own, part=part) for part in ("palm", "cloud", "broker", "database")]
        wrongly += [replace(own, fault=other) for other in others]
        (fault,) = wrong(store, early, late, *wrongly)
        assert f"{NODE}: gap without a cause" in fault
        assert reason in fault


def test_each_of_many_gaps_needs_its_own_cause(burnt: Store) -> None:
    later = START + 600 * SECOND
    put(burnt, gap(3, time=(later, later + SECOND), lost=()))
    (fault,) = wrong(burnt, CUT)
    assert "from 600.0 to 601.0 s" in fault
    assert wrong(burnt, CUT, blow("hang", "database", 595.0, 601.0)) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("DELETE FROM frames WHERE sequence = 1", "page 0 has 1"),
        ("UPDATE pages SET samples = samples + 1", "by its totals"),
        ("UPDATE sequences SET first = 1", "holes: 1 ranges from 1"),
        (
            (
                "INSERT INTO sequences (slot, node, boot, first, last) "
                "SELECT slot, node, boot, 9, 9 FROM sequences"
            ),
            "holes: 2 ranges",
        ),
    ],
)
def test_sums_must_be_those_of_the_frames(burnt: Store, change: str, words: str) -> None:
    burnt.write(lambda connection: connection.exec_driver_sql(change)).result(120)
    (fault,) = wrong(burnt, CUT)
    assert words in fault


def test_hole_that_a_gap_names_is_none(burnt: Store) -> None:
    put(burnt, stretch(5))
    (fault,) = wrong(burnt, CUT)
    assert "holes: 2 ranges from 0" in fault
    put(burnt, naming(6, (1, 3, 4)))
    assert wrong(burnt, CUT) == []


def test_stroke_reads_well() -> None:
    assert str(Stroke("cut", "cloud", 1.0, 3.5)) == "    1.0 s  cut cloud for 2.5 s"


@pytest.mark.parametrize(
    ("skipped", "missing"), [(0, [3, 4, 6]), (2, [3, 4, 6]), (3, []), (None, [])]
)
def test_viewer_gets_each_stored_frame_or_the_number_of_those_left_out(
    skipped: int | None, missing: list[int]
) -> None:
    made = [Position(1, number) for number in range(9)]
    stored, before = {1: SequenceRanges([(0, 6), (8, 8)])}, {1: SequenceRanges([(0, 1)])}
    seen = Seen(begun=True, frames=[(1, 2), (1, 8), (1, 5)], skipped=skipped, pages=1, wrong=[])
    assert [each.sequence for each in left_out(seen, made, stored, before)] == missing
