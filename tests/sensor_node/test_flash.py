from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING, Any

import pytest

from eskin.errors import FlashError
from eskin.interval import Interval
from eskin.messages import Block, Encoding, Gap, Peak, Position, decode_message
from eskin.peaks import Verdict
from eskin.sequences import SequenceRanges
from eskin.tube import Tube
from sensor_node.flash import FAILED, FULL, Flash
from sensor_node.losses import MOST_SPANS

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sensor_node.batch import Batch

ROOM = 1 << 20


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "flash.sqlite"


@pytest.fixture
def flash(path: Path) -> Iterator[Flash]:
    opened = Flash(path, capacity=ROOM, epoch=1)
    yield opened
    opened.close()


def add_block(batch: Batch, n: int = 250) -> Block:
    position = batch.position()
    tube = Tube((position.sequence, position.sequence + 5), 10, Interval([1.0] * n), "F", 1.0)
    block = Block.pack(position, "t01.capacitance", 0, tube, Encoding.F64)
    batch.add(block)
    return block


def add_peak(batch: Batch) -> None:
    sides = (0.0, 1.0)
    batch.add(
        Peak(
            position=batch.position(),
            channel="t01.area",
            unit="m2",
            time=(0, 9),
            verdict=Verdict.CERTAIN,
            count=(1, 1),
            height=sides,
            prominence=sides,
            coverage=1.0,
        )
    )


def fill(flash: Flash, blocks: int, *, peak_every: int = 0) -> list[Position]:
    positions = []
    for number in range(blocks):
        with flash.batch() as batch:
            positions.append(add_block(batch).position)
            if peak_every and number % peak_every == 0:
                add_peak(batch)
                positions.append(Position(flash.boot, batch.records[-1].sequence))
    return positions


def waiting(flash: Flash) -> list[Any]:
    return [decode_message(stored.body) for stored in flash.pending(None, 1_000_000)]


def fail_writes(flash: Flash) -> None:
    """As a full disk does: no page can be added."""
    pages = flash._db.execute("PRAGMA page_count").fetchone()[0]
    flash._db.execute(f"PRAGMA max_page_count = {pages}")


def make_room(flash: Flash) -> None:
    flash._db.execute("PRAGMA max_page_count = 1000000")


def test_boot_grows_with_each_opening_before_anything_is_said(path: Path) -> None:
    for boot in (1, 2, 3):
        flash = Flash(path, capacity=ROOM, epoch=1)
        assert flash.boot == boot
        with sqlite3.connect(path) as other:
            kept = other.execute("SELECT value FROM counter WHERE name = 'boot'").fetchone()
        other.close()
        assert kept == (boot,)
        flash.close()


def test_what_was_committed_is_there_after_reopening(path: Path) -> None:
    flash = Flash(path, capacity=ROOM, epoch=1)
    said = fill(flash, 5)
    level = flash.usage()
    flash.close()
    again = Flash(path, capacity=ROOM, epoch=1)
    assert [stored.position for stored in again.pending(None, 100)] == said
    assert again.usage() == level
    with again.batch() as batch:
        assert batch.position() == Position(2, 0)
    again.close()


def test_pending_goes_on_behind_a_position(flash: Flash) -> None:
    said = fill(flash, 6)
    assert [stored.position for stored in flash.pending(said[1], 3)] == said[2:5]


def test_forget_removes_only_what_was_acknowledged(flash: Flash) -> None:
    said = fill(flash, 6)
    flash.forget([(1, 0, 2), (1, 4, 4), (9, 0, 100)])
    assert [stored.position for stored in flash.pending(None, 100)] == [said[3], said[5]]
    usage = flash.usage()
    assert usage.messages == 2
    assert usage.used == sum(len(stored.body) for stored in flash.pending(None, 100))


def test_held_is_the_lowest_waiting_position(flash: Flash) -> None:
    assert flash.held() == Position(1, 0)
    fill(flash, 4)
    flash.forget([(1, 0, 1)])
    assert flash.held() == Position(1, 2)
    flash.forget([(1, 0, 9)])
    assert flash.held() == Position(1, 4)


def test_held_counts_no_position_whose_fate_is_open(flash: Flash) -> None:
    fill(flash, 2)
    flash.forget([(1, 0, 1)])
    with flash.batch() as batch:
        add_block(batch)
        assert flash.held() == Position(1, 2)


def test_full_flash_gives_up_oldest_blocks_first_and_names_them(path: Path) -> None:
    flash = Flash(path, capacity=100_000, epoch=1)
    said = fill(flash, 60, peak_every=4)
    left = waiting(flash)
    gaps = [message for message in left if isinstance(message, Gap)]
    kept = {message.position for message in left}
    lost = [position for position in said if position not in kept]
    assert flash.usage().used <= 100_000
    assert len(lost) > 20
    # Peaks outlive blocks, and the oldest blocks went first.
    assert sum(isinstance(message, Peak) for message in left) == 15
    blocks = [message.position for message in left if isinstance(message, Block)]
    assert min(blocks) > max(lost)
    named = SequenceRanges(
        (first, last) for gap in gaps for boot, first, last in gap.lost if boot == 1
    )
    assert all(position.sequence in named for position in lost)
    assert sum(last - first + 1 for first, last in named) == len(lost)
    assert {gap.reason for gap in gaps} == {FULL}
    assert sum(gap.messages for gap in gaps) == len(lost)
    assert sum(gap.samples for gap in gaps) == 250 * len(lost)
    assert min(gap.time[0] for gap in gaps) == lost[0].sequence
    assert max(gap.time[1] for gap in gaps) == lost[-1].sequence + 5 + 10 * 249
    flash.close()


def test_gap_that_nobody_has_read_grows_and_one_that_was_read_stays(path: Path) -> None:
    flash = Flash(path, capacity=100_000, epoch=1)
    fill(flash, 40)
    before = [message for message in waiting(flash) if isinstance(message, Gap)]
    assert len(before) == 1
    fill(flash, 10)
    after = [message for message in waiting(flash) if isinstance(message, Gap)]
    assert after[0] == before[0]
    assert len(after) == 2
    assert flash.usage().gaps == 2
    flash.close()


def test_gaps_stay_within_what_one_message_may_name(path: Path) -> None:
    flash = Flash(path, capacity=100_000, epoch=1)
    said = fill(flash, 400, peak_every=1)
    left = waiting(flash)
    kept = {message.position for message in left}
    gaps = [message for message in left if isinstance(message, Gap)]
    assert len(gaps) > 1
    assert all(len(gap.lost) <= MOST_SPANS for gap in gaps)
    assert sum(gap.messages for gap in gaps) == sum(p not in kept for p in said)
    flash.close()


def test_full_of_events_gives_up_events_and_still_says_so(path: Path) -> None:
    flash = Flash(path, capacity=70_000, epoch=1)
    said = 0
    while not any(gap for gap in waiting(flash) if isinstance(gap, Gap)):
        with flash.batch() as batch:
            for _ in range(200):
                add_peak(batch)
            said += 200
    gaps = [message for message in waiting(flash) if isinstance(message, Gap)]
    kept = sum(isinstance(message, Peak) for message in waiting(flash))
    assert sum(gap.messages for gap in gaps) == said - kept > 0
    flash.close()


def test_failed_write_is_a_clear_error_and_a_gap_when_room_is_back(flash: Flash) -> None:
    said = fill(flash, 3)
    fail_writes(flash)
    lost: list[Position] = []
    for _ in range(2):
        with pytest.raises(FlashError, match="full"), flash.batch() as batch:
            lost += [add_block(batch, 1000).position for _ in range(20)]
    assert flash.held() == Position(1, 0)
    make_room(flash)
    with flash.batch() as batch:
        late = add_block(batch)
    left = waiting(flash)
    gap = next(message for message in left if isinstance(message, Gap))
    assert [message.position for message in left] == [*said, gap.position, late.position]
    assert gap.reason == FAILED
    assert gap.messages == 40
    assert gap.samples == 40_000
    named = SequenceRanges((first, last) for _, first, last in gap.lost)
    assert all(position.sequence in named for position in lost)
    assert all(position.sequence not in named for position in said)
    assert late.position > gap.position > max(lost)


def test_error_of_a_part_inside_a_batch_stores_none_of_it(flash: Flash) -> None:
    def fail(batch: Batch) -> None:
        add_block(batch)
        raise FlashError("truth is full")

    with pytest.raises(FlashError, match="truth is full"), flash.batch() as batch:
        fail(batch)
    assert waiting(flash) == []
    with flash.batch() as batch:
        add_block(batch)
    assert [message.messages for message in waiting(flash) if isinstance(message, Gap)] == [1]


def test_opening_what_is_no_flash_is_a_clear_error(path: Path) -> None:
    path.write_bytes(b"no database at all, but long enough to be looked at" * 100)
    with pytest.raises(FlashError, match="cannot be opened"):
        Flash(path, capacity=ROOM, epoch=1)


def test_long_failure_is_told_in_one_readable_gap(tmp_path: Path) -> None:
    flash = Flash(tmp_path / "flash.sqlite", capacity=10**8, epoch=1)
    commit = flash._commit

    def full(_records: object) -> None:
        raise FlashError("disk is full")

    flash._commit = full  # type: ignore[method-assign, assignment]  # a fault is injected
    for _ in range(200):
        with pytest.raises(FlashError), flash.batch() as batch:
            batch.add(Gap(batch.position(), "x", (0, 1), 0, 7, ()))
    flash._commit = commit  # type: ignore[method-assign]  # and taken back
    with flash.batch():
        pass
    (stored,) = flash.pending(None, 10)
    gap = decode_message(stored.body)
    assert isinstance(gap, Gap)
    assert gap.messages == 200
    assert len(gap.lost) == 1


def test_second_node_on_one_flash_is_refused(tmp_path: Path) -> None:
    first = Flash(tmp_path / "flash.sqlite", capacity=10**8, epoch=1)
    with pytest.raises(FlashError, match="another node runs on this flash"):
        Flash(tmp_path / "flash.sqlite", capacity=10**8, epoch=1)
    first.close()
    Flash(tmp_path / "flash.sqlite", capacity=10**8, epoch=1).close()
