"""Each commit writes only the changed ranges of stored sequence numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_cloud.store.schema.tables import sequences
from eskin_cloud.store.write.duplicates import RangeChange, StoredSequences
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import select

from eskin.wire.sequence_set import SequenceRanges
from tests.unit.cloud.clouds import batch, cached_rows, count_frames
from tests.unit.cloud.messages import stretch

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

COMMITS = st.lists(st.lists(st.tuples(st.integers(0, 40), st.integers(0, 5)), max_size=8))


@given(commits=COMMITS)
def test_written_changes_equal_the_ranges(
    commits: list[list[tuple[int, int]]],
) -> None:
    memory, written = StoredSequences(), dict[int, int]()
    for commit in commits:
        for first, more in commit:
            memory.add(first, first + more)
        for first, before, now in memory.changes():
            assert written.get(first) == before
            if now is None:
                del written[first]
            else:
                written[first] = now
        memory.written()
        assert list(memory.changes()) == []
        assert written == dict(memory) == dict(StoredSequences(sorted(written.items())))


def test_number_after_many_gaps_changes_one_range() -> None:
    memory = StoredSequences((number, number) for number in range(0, 20_000, 2))
    memory.add(20_000)
    assert list(memory.changes()) == [RangeChange(20_000, None, 20_000)]
    memory.written()
    memory.add(9_999)
    assert sorted(memory.changes()) == [(9_998, 9_998, 10_000), (10_000, 10_000, None)]


@pytest.mark.anyio
async def test_cost_of_a_commit_is_independent_of_gaps(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    even = [stretch(number) for number in range(0, 600, 2)]
    assert (await stand.ingest(batch(*even))).status_code == 200

    def fail(_: SequenceRanges) -> None:
        raise AssertionError("all of it is looked at")

    monkeypatch.setattr(SequenceRanges, "__iter__", fail)
    answer = await stand.ingest(batch(stretch(600), stretch(601), stretch(300)))
    results = [item["result"] for item in answer.json()["items"]]
    assert results == ["stored", "stored", "duplicate"]
    monkeypatch.undo()
    missing = [stretch(number) for number in range(1, 600, 2)]
    answer = await stand.ingest(batch(*missing))
    assert {item["result"] for item in answer.json()["items"]} == {"stored"}
    stand.cloud.store.clear_caches()
    answer = await stand.ingest(batch(*even, *missing))
    assert {item["result"] for item in answer.json()["items"]} == {"duplicate"}
    assert count_frames(stand) == 602
    with stand.cloud.store.read() as connection:
        rows = connection.execute(select(sequences.c.first, sequences.c.last)).all()
    assert [tuple(row) for row in rows] == [(0, 601)]


@pytest.mark.anyio
async def test_cache_of_rows_is_bounded(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eskin_cloud.store.write.write_cache._MAX_ROWS", 3)
    for number in range(6):
        said = stretch(2 * number, channel=f"t{number:02}.pressure"), stretch(2 * number + 1)
        answer = await stand.ingest(batch(*said))
        assert {item["result"] for item in answer.json()["items"]} == {"stored"}
        assert cached_rows(stand.cloud.store) <= 3 + 3
    assert count_frames(stand) == 12
