"""Many outboxes on one file: apart from each other, durable together."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.firmware.message_writer import FRAME, MessageWriter, Record
from eskin_sensor_node.fleet.outbox import MemberOutbox
from eskin_sensor_node.fleet.report_kernels import Nodes
from eskin_sensor_node.machine.flash.file import FlashFile
from eskin_sensor_node.machine.flash.flash import Partition
from eskin_sensor_node.machine.flash.sealing import UNREADABLE

from eskin.errors import FlashError
from eskin.wire.frames import Statements
from tests.unit.sensor_node.flashes import KEY, change, on_disk

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

NAMES = ["a-0001", "a-0002"]
LAYOUT = bytes(range(32))


@pytest.fixture
def storage(tmp_path: Path) -> Iterator[FlashFile]:
    opened = FlashFile(tmp_path / "flash.sqlite", NAMES, key=KEY, epoch=7)
    yield opened
    opened.close()


def outboxes(storage: FlashFile) -> list[MemberOutbox]:
    nodes = Nodes(*(np.zeros(2, np.int64) for _ in range(3)))
    return [
        MemberOutbox(
            Partition(storage, name),
            nodes,
            row,
            capacity=2**16,
            window=10,
            resend_after=1000,
            status_every=1000,
            message_writer=partial(MessageWriter, layout=LAYOUT),
        )
        for row, name in enumerate(NAMES)
    ]


def frame(outbox: MemberOutbox, body: bytes) -> Record:
    return Record(FRAME, outbox.next_sequence(), body, (1, 2), 250)


def fail(storage: FlashFile, work: Callable[[], None]) -> None:
    with storage.commit():
        work()
        raise FlashError("disk full")


def test_members_do_not_see_each_other(storage: FlashFile) -> None:
    one, other = outboxes(storage)
    with storage.commit():
        for outbox, body in ((one, b"one"), (other, b"other")):
            outbox.write([frame(outbox, body)])
    for outbox in (one, other):
        outbox.settle([])
        outbox.connect(0)
    assert [kept.body for kept in one.due(0, 9)] == [b"one"]
    with storage.commit():
        one.acknowledge([(7, 0, 99)])
    assert (one.messages, other.messages) == (0, 1)
    assert [kept.body for kept in other.due(0, 9)] == [b"other"]


def test_failed_commit_is_reported_by_each_member(storage: FlashFile) -> None:
    members = outboxes(storage)
    said = {outbox: [frame(outbox, b"lost")] for outbox in members}

    def write() -> None:
        for outbox, records in said.items():
            outbox.write(records)

    with pytest.raises(FlashError, match="full"):
        fail(storage, write)
    for outbox, records in said.items():
        outbox.lose(records)
        gaps = outbox.pending_gap()
        with storage.commit():
            outbox.write(gaps)
        outbox.settle(gaps)
        outbox.connect(0)
        (kept,) = outbox.due(0, 9)
        (gap,) = Statements.decode(kept.body).gaps
        assert (gap.messages, gap.samples, gap.lost) == (1, 250, ((7, 0, 0),))


def test_undone_acknowledgements_leave_everything_to_be_sent_again(storage: FlashFile) -> None:
    one, other = outboxes(storage)
    for outbox in (one, other):
        records = [frame(outbox, b"body")]
        with storage.commit():
            outbox.write(records)
        outbox.settle(records)
        outbox.connect(0)
        assert len(outbox.due(0, 9)) == 1

    def acknowledge() -> None:
        for outbox in (one, other):
            outbox.acknowledge([(7, 0, 0)])

    with pytest.raises(FlashError, match="full"):
        fail(storage, acknowledge)
    for outbox in (one, other):
        outbox.resync(1)
        assert outbox.messages == 1
        assert [kept.body for kept in outbox.due(1, 9)] == [b"body"]


def test_each_start_counts_the_boot_of_each_member(tmp_path: Path) -> None:
    path = tmp_path / "flash.sqlite"
    FlashFile(path, NAMES[:1], key=KEY, epoch=7).close()
    again = FlashFile(path, NAMES, key=KEY, epoch=5)
    assert [Partition(again, name).boot for name in NAMES] == [8, 5]
    with pytest.raises(FlashError, match="another process runs"):
        FlashFile(path, NAMES, key=KEY)
    again.close()


def test_older_copy_starts_above_all_numbers_used_since(tmp_path: Path) -> None:
    path, copy = tmp_path / "flash.sqlite", tmp_path / "copy.sqlite"
    FlashFile(path, NAMES, key=KEY, epoch=100).close()
    shutil.copy(path, copy)
    for now in (160, 190):
        FlashFile(path, NAMES, key=KEY, epoch=now).close()
    older = FlashFile(copy, NAMES, key=KEY, epoch=220)
    assert [Partition(older, name).boot for name in NAMES] == [220, 220]
    older.close()


def test_no_file_shows_what_members_keep(storage: FlashFile, tmp_path: Path) -> None:
    one, other = outboxes(storage)
    secrets = b"what one keeps", b"what another keeps"
    with storage.commit():
        for outbox, body in zip((one, other), secrets, strict=True):
            outbox.write([frame(outbox, body)])
    for partition in (Partition(storage, name) for name in NAMES):
        partition.store_answer(secrets[0] + b" of itself")
    assert not [secret for secret in secrets if secret in on_disk(tmp_path)]
    assert Partition(storage, NAMES[0]).answer() == secrets[0] + b" of itself"
    storage.close()
    assert not [secret for secret in secrets if secret in on_disk(tmp_path)]


def test_records_exchanged_between_members_become_gaps(storage: FlashFile, tmp_path: Path) -> None:
    for outbox, body in zip(outboxes(storage), (b"one", b"other"), strict=True):
        with storage.commit():
            outbox.write([frame(outbox, body), frame(outbox, body)])
    path = tmp_path / "flash.sqlite"
    with closing(sqlite3.connect(path)) as db:
        found = dict(db.execute("SELECT member, body FROM message WHERE sequence = 1").fetchall())
    for member, body in zip(found, reversed(found.values()), strict=True):
        change(path, "UPDATE message SET body = ? WHERE sequence = 1 AND member = ?", body, member)
    for name, body in zip(NAMES, (b"one", b"other"), strict=True):
        partition = Partition(storage, name)
        with pytest.raises(FlashError, match="descriptions"):
            partition.after((-1, -1), 9)
        partition.store_descriptions(LAYOUT, {})
        whole, lost = partition.after((-1, -1), 9)
        (gap,) = Statements.decode(lost.body).gaps
        assert whole.body == body
        assert (gap.reason, gap.lost) == (UNREADABLE, ((7, 1, 1),))
        assert partition.gaps() == 1
        partition.store_counts(3, 9)
        assert Partition(storage, name).gaps() == 3
        assert partition.level() == (2, 2 * len(body))


def test_another_key_is_refused(storage: FlashFile, tmp_path: Path) -> None:
    storage.close()
    with pytest.raises(FlashError, match="another key"):
        FlashFile(tmp_path / "flash.sqlite", NAMES, key=bytes(32))
