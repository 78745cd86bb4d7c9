"""Many outboxes on one file: apart from each other, durable together."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from eskin.errors import FlashError
from eskin.messages import Gap, decode_message
from sensor_node.firmware.record import BLOCK, Record
from sensor_node.fleet.outbox import MemberOutbox
from sensor_node.fleet.storage import Storage
from sensor_node.fleet.telling import Nodes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

NAMES = ["a-0001", "a-0002"]


@pytest.fixture
def storage(tmp_path: Path) -> Iterator[Storage]:
    opened = Storage(tmp_path / "flash.sqlite", NAMES, epoch=7)
    yield opened
    opened.close()


def outboxes(storage: Storage) -> list[MemberOutbox]:
    nodes = Nodes(*(np.zeros(2, np.int64) for _ in range(3)))
    return [
        MemberOutbox(
            storage.partition(name),
            nodes,
            row,
            capacity=2**16,
            window=10,
            resend_after=1000,
            status_every=1000,
        )
        for row, name in enumerate(NAMES)
    ]


def block(outbox: MemberOutbox, body: bytes) -> Record:
    return Record(BLOCK, outbox.next_sequence(), body, (1, 2), 250)


def fail(storage: Storage, work: Callable[[], None]) -> None:
    with storage.commit():
        work()
        raise FlashError("disk full")


def test_members_do_not_see_each_other(storage: Storage) -> None:
    one, other = outboxes(storage)
    with storage.commit():
        for outbox, body in ((one, b"one"), (other, b"other")):
            outbox.write([block(outbox, body)])
    for outbox in (one, other):
        outbox.settle([])
        outbox.connect(0)
    assert [kept.body for kept in one.due(0, 9)] == [b"one"]
    with storage.commit():
        one.acknowledge([(7, 0, 99)])
    assert (one.messages, other.messages) == (0, 1)
    assert [kept.body for kept in other.due(0, 9)] == [b"other"]


def test_failed_commit_is_told_by_each_member(storage: Storage) -> None:
    members = outboxes(storage)
    said = {outbox: [block(outbox, b"lost")] for outbox in members}

    def write() -> None:
        for outbox, records in said.items():
            outbox.write(records)

    with pytest.raises(FlashError, match="full"):
        fail(storage, write)
    for outbox, records in said.items():
        outbox.lose(records)
        gaps = outbox.unsaid()
        with storage.commit():
            outbox.write(gaps)
        outbox.settle(gaps)
        outbox.connect(0)
        (kept,) = outbox.due(0, 9)
        gap = decode_message(kept.body)
        assert isinstance(gap, Gap)
        assert (gap.messages, gap.samples, gap.lost) == (1, 250, ((7, 0, 0),))


def test_undone_acknowledgements_leave_everything_to_be_sent_again(storage: Storage) -> None:
    one, other = outboxes(storage)
    for outbox in (one, other):
        records = [block(outbox, b"body")]
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
        outbox.look_again(1)
        assert outbox.messages == 1
        assert [kept.body for kept in outbox.due(1, 9)] == [b"body"]


def test_each_start_counts_the_boot_of_each_member(tmp_path: Path) -> None:
    path = tmp_path / "flash.sqlite"
    Storage(path, NAMES[:1], epoch=7).close()
    again = Storage(path, NAMES, epoch=20)
    assert [again.partition(name).boot for name in NAMES] == [8, 20]
    with pytest.raises(FlashError, match="another fleet runs"):
        Storage(path, NAMES)
    again.close()
