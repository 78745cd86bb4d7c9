from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import pytest
from eskin_sensor_node.firmware.eviction import MOST_SPANS
from eskin_sensor_node.firmware.gap_reasons import FAILED, FULL, OVERRUN, TEXTS

from eskin.errors import FlashError
from eskin.wire.frames import Frame, Statements
from eskin.wire.sequence_set import SequenceRanges
from tests.unit.sensor_node.designs import waiting
from tests.unit.sensor_node.flashes import change, open_flash
from tests.unit.sensor_node.stores import Store, plain

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.outbox import Batch


@pytest.fixture
def small(path: Path) -> Iterator[Store]:
    opened = Store(path, 30_000)
    yield opened
    opened.flash.close()


def test_boot_grows_with_each_opening(path: Path) -> None:
    for boot in (1, 2, 3):
        flash = open_flash(path)
        assert flash.boot == boot
        with sqlite3.connect(path) as other:
            kept = other.execute("SELECT boot FROM member").fetchone()
        other.close()
        assert kept == (boot,)
        flash.close()


def test_older_copy_starts_above_all_numbers_used_since(path: Path) -> None:
    copy = path.with_name("copy")
    open_flash(path, epoch=100).close()
    shutil.copy(path, copy)
    assert [_start(path, now=now) for now in (160, 160, 190)] == [160, 161, 190]
    assert _start(copy, now=220) == 220


def test_ends_of_the_latest_former_boots_are_reported(path: Path) -> None:
    ends = []
    for _ in range(12):
        store = Store(path)
        store.fill(3)
        ends.append(store.positions()[-1])
        store.flash.close()
        Store(path).flash.close()  # says nothing
    again = Store(path)
    assert again.outbox.ended() == ends[-8:]
    again.fill(2)
    again.outbox.restart()
    assert again.outbox.ended()[-1][0] == again.outbox.boot - 1
    again.flash.close()


def test_clock_that_is_behind_takes_no_number_twice(path: Path) -> None:
    assert [_start(path, now=now) for now in (160, 0, 90)] == [160, 161, 162]


def _start(path: Path, *, now: int) -> int:
    flash = open_flash(path, epoch=now)
    flash.close()
    return flash.boot


def test_what_was_committed_is_there_after_reopening(path: Path) -> None:
    store = Store(path)
    said = store.fill(5)
    usage = store.outbox.usage()
    store.flash.close()
    again = Store(path)
    assert again.positions() == said
    assert again.outbox.usage() == usage
    assert again.outbox.boot == 2
    assert again.outbox.next_sequence() == 0
    again.flash.close()


def test_reading_goes_on_behind_a_position(store: Store) -> None:
    said = store.fill(6)
    assert [kept.position for kept in store.flash.after(said[1], 3)] == said[2:5]


def test_only_what_was_acknowledged_is_forgotten(store: Store) -> None:
    said = store.fill(6)
    store.outbox.acknowledge([(1, 0, 2), (1, 4, 4), (9, 0, 100)])
    assert store.positions() == [said[3], said[5]]
    messages, used, _, _ = store.outbox.usage()
    assert messages == 2
    assert used == sum(len(kept.body) for kept in waiting(store.flash))


def test_what_cannot_be_forgotten_stays(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise FlashError("worn out")

    said = store.fill(3)
    usage = store.outbox.usage()
    with monkeypatch.context() as patch:
        patch.setattr(store.flash, "commit", fail)
        with pytest.raises(FlashError, match="worn out"):
            store.outbox.acknowledge([(1, 0, 1)])
    assert store.positions() == said
    assert store.outbox.usage() == usage
    store.outbox.acknowledge([(1, 0, 1)])
    assert store.positions() == said[2:]


def test_held_is_the_lowest_waiting_position(store: Store) -> None:
    assert store.outbox.held() == (1, 0)
    store.fill(4)
    store.outbox.acknowledge([(1, 0, 1)])
    assert store.outbox.held() == (1, 2)
    store.outbox.acknowledge([(1, 0, 9)])
    assert store.outbox.held() == (1, 4)


def test_held_counts_no_position_whose_fate_is_open(store: Store) -> None:
    store.fill(2)
    store.outbox.acknowledge([(1, 0, 1)])
    with store.outbox.batch() as batch:
        store.add_frame(batch)
        assert store.outbox.held() == (1, 2)


def test_full_flash_gives_up_oldest_frames_first_and_names_them(small: Store) -> None:
    said = small.fill(60, peak_every=4)
    left = small.messages()
    gaps = small.gaps()
    kept = {plain(message) for message in left}
    lost = [position for position in said if position not in kept]
    assert small.outbox.usage()[1] <= 30_000
    assert len(lost) > 20
    # Peaks outlive frames, and the oldest frames went first.
    assert sum(len(message.peaks) for message in left if isinstance(message, Statements)) == 15
    assert min(plain(message) for message in left if isinstance(message, Frame)) > max(lost)
    named = SequenceRanges(
        (first, last) for gap in gaps for boot, first, last in gap.lost if boot == 1
    )
    assert all(sequence in named for _, sequence in lost)
    assert sum(last - first + 1 for first, last in named) == len(lost)
    assert {gap.reason for gap in gaps} == {TEXTS[FULL]}
    assert sum(gap.messages for gap in gaps) == len(lost)
    assert sum(gap.samples for gap in gaps) == 250 * len(lost)
    assert min(gap.time[0] for gap in gaps) == lost[0][1]
    assert max(gap.time[1] for gap in gaps) == lost[-1][1] + 5 + 10 * 249


def test_unread_gap_grows_and_read_gap_stays(small: Store) -> None:
    small.fill(40)
    small.fill(10)
    before = small.gaps()
    assert len(before) == 1
    small.read_all()
    small.fill(10)
    after = small.gaps()
    assert after[0] == before[0]
    assert len(after) == 2
    assert small.outbox.usage()[3] == 2


def test_gaps_stay_within_what_one_message_may_name(small: Store) -> None:
    said = small.fill(400, peak_every=1)
    kept = set(small.positions())
    gaps = small.gaps()
    assert len(gaps) > 1
    assert all(len(gap.lost) <= MOST_SPANS for gap in gaps)
    assert sum(gap.messages for gap in gaps) == sum(p not in kept for p in said)


def test_full_of_events_evicts_events_and_reports_it(path: Path) -> None:
    store = Store(path, 30_000)
    said = 0
    while not store.gaps():
        with store.outbox.batch() as batch:
            for _ in range(200):
                store.add_peak(batch)
            said += 200
    stated = [each for each in store.messages() if isinstance(each, Statements)]
    kept = sum(len(each.peaks) for each in stated)
    assert sum(gap.messages for gap in store.gaps()) == said - kept > 0
    store.flash.close()


def test_flash_that_shows_what_it_does_not_hold_does_not_stop_the_node(
    small: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(small.flash, "delete", lambda *_: (0, 0))
    small.fill(40)
    frames = [message for message in small.messages() if isinstance(message, Frame)]
    assert len(frames) == 40


def test_gap_gives_way_when_nothing_else_is_left_and_its_losses_stay_counted(path: Path) -> None:
    store = Store(path, 2048)
    said = 0
    for _ in range(400):
        said += len(store.fill(1))
        store.read_all()  # so that no gap may grow
    gaps = store.gaps()
    assert store.outbox.usage()[1] <= 2048
    assert len(gaps) < 60
    frames = sum(isinstance(message, Frame) for message in store.messages())
    given_up = store.outbox.usage()[3] - len(gaps)
    assert sum(gap.messages for gap in gaps) == said - frames + given_up
    store.flash.close()


def test_failed_write_is_a_clear_error_and_a_gap_when_room_is_back(store: Store) -> None:
    said = store.fill(3)
    store.fail_writes()
    lost: list[Record] = []
    for _ in range(2):
        with pytest.raises(FlashError, match="full"), store.outbox.batch() as batch:
            lost += [store.add_frame(batch, 1000) for _ in range(20)]
    assert store.outbox.held() == (1, 0)
    store.make_room()
    with store.outbox.batch() as batch:
        late = store.add_frame(batch).sequence
    (gap,) = store.gaps()
    (stated,) = [plain(each) for each in store.messages() if isinstance(each, Statements)]
    assert store.positions() == [*said, stated, (1, late)]
    assert gap.reason == TEXTS[FAILED]
    assert gap.messages == 40
    assert gap.samples == 40_000
    named = SequenceRanges((first, last) for _, first, last in gap.lost)
    assert all(record.sequence in named for record in lost)
    assert all(sequence not in named for _, sequence in said)
    assert late > stated[1] > lost[-1].sequence


def test_error_of_a_part_inside_a_batch_stores_none_of_it(store: Store) -> None:
    def fail(batch: Batch) -> None:
        store.add_frame(batch)
        raise FlashError("truth is full")

    with pytest.raises(FlashError, match="truth is full"), store.outbox.batch() as batch:
        fail(batch)
    assert store.messages() == []
    with store.outbox.batch() as batch:
        store.add_frame(batch)
    assert [gap.messages for gap in store.gaps()] == [1]


def test_opening_what_is_no_flash_is_a_clear_error(path: Path) -> None:
    path.write_bytes(b"no database at all, but long enough to be looked at" * 100)
    with pytest.raises(FlashError, match="cannot be opened"):
        open_flash(path)


def test_long_failure_is_one_readable_gap(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def full() -> None:
        raise FlashError("disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(store.flash, "commit", full)
        for _ in range(200):
            with pytest.raises(FlashError), store.outbox.batch() as batch:
                batch.take([store.outbox.message_writer.gap(OVERRUN, (0, 1), 7)])
    with store.outbox.batch():
        pass
    (gap,) = store.gaps()
    assert (gap.messages, gap.samples) == (200, 1400)
    assert len(gap.lost) == 1


def test_second_node_on_one_flash_is_refused(path: Path) -> None:
    first = open_flash(path)
    with pytest.raises(FlashError, match="another process runs on this flash"):
        open_flash(path)
    first.close()
    open_flash(path).close()


def test_damaged_last_number_of_a_boot_is_not_reported(tmp_path: Path) -> None:
    path = tmp_path / "flash.sqlite"
    for epoch in (10, 20):
        store = Store(path, epoch=epoch)
        store.fill(2)
        store.flash.close()
    change(path, "UPDATE ended SET last = last + 4 WHERE boot = 10")
    with closing(open_flash(path, epoch=30)) as flash:
        assert flash.ended() == [(20, 1)]
