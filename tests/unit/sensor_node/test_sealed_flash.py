"""What lies on a node's chip is sealed, and what does not open is reported as lost."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import pytest
from eskin_sensor_node.firmware.message_writer import STATEMENTS, Record
from eskin_sensor_node.machine.flash.sealing import UNREADABLE
from eskin_sensor_node.node.factory import open_flash as open_as_set

from eskin.errors import FlashError
from eskin.wire.frames import Statements
from tests.unit.sensor_node import designs
from tests.unit.sensor_node.flashes import change, on_disk, open_flash
from tests.unit.sensor_node.stores import PATCH, Store, plain

if TYPE_CHECKING:
    from pathlib import Path

SECRET = b"what must stay secret"
TIME = (1_790_000_000_123_456_789, 1_790_000_002_987_654_321)


def sealed_bodies(path: Path) -> list[bytes]:
    with closing(sqlite3.connect(path)) as db:
        return [row[0] for row in db.execute("SELECT body FROM message ORDER BY boot, sequence")]


def swap(path: Path) -> None:
    """Exchange what two records hold."""
    one, other = sealed_bodies(path)[1:3]
    for sequence, body in ((1, other), (2, one)):
        change(path, "UPDATE message SET body = ? WHERE sequence = ?", body, sequence)


def test_no_file_shows_what_a_node_keeps(store: Store, path: Path) -> None:
    said = Record(STATEMENTS, 0, SECRET * 9, TIME, 3)
    store.flash.begin()
    store.flash.append(1, said, 0)
    store.flash.store_answer(SECRET + b"answer")
    store.flash.store_charge(SECRET + b"charge")
    store.flash.commit()
    store.outbox._sequence = 1
    store.fill(3)
    secrets = (SECRET, PATCH.quantity.encode(), *(instant.to_bytes(8, "big") for instant in TIME))
    assert not [secret for secret in secrets if secret in on_disk(path.parent)]
    kept = designs.waiting(store.flash)[0]
    assert (kept.body, kept.time) == (said.body, TIME)
    assert store.flash.answer() == SECRET + b"answer"
    assert store.flash.charge() == SECRET + b"charge"
    store.flash.close()
    assert not [secret for secret in secrets if secret in on_disk(path.parent)]


def test_outbox_counts_the_bytes_that_the_firmware_wrote(store: Store) -> None:
    store.fill(5)
    bodies = sum(len(kept.body) for kept in designs.waiting(store.flash))
    assert store.flash.level() == (5, bodies)
    assert store.flash.delete(1, 0, 4) == (5, bodies)


def test_nonces_never_repeat_over_records_openings_and_copies(tmp_path: Path) -> None:
    first, copy = tmp_path / "first" / "flash.sqlite", tmp_path / "copy" / "flash.sqlite"
    for _ in range(2):
        store = Store(first)
        store.fill(20)
        store.flash.close()
    shutil.copytree(first.parent, copy.parent)
    for path in (first, copy):
        store = Store(path)
        store.fill(20)
        store.flash.close()
    bodies = set(sealed_bodies(first) + sealed_bodies(copy))
    assert len(bodies) == 80
    assert len({body[:28] for body in bodies}) == 80


def test_exchanged_records_become_gaps_in_their_places(store: Store, path: Path) -> None:
    said = store.fill(4)
    usage = store.outbox.usage()
    lost = designs.waiting(store.flash)[1:3]
    swap(path)
    assert store.positions() == said
    gaps = store.gaps()
    stated = [plain(each) for each in store.messages() if isinstance(each, Statements)]
    assert (stated, [gap.reason for gap in gaps]) == (said[1:3], [UNREADABLE] * 2)
    assert [gap.lost for gap in gaps] == [((1, n, n),) for n in (1, 2)]
    assert [(gap.messages, gap.samples) for gap in gaps] == [(1, 250)] * 2
    for gap, kept in zip(gaps, lost, strict=True):
        assert gap.time[0] <= kept.time[0] <= kept.time[1] <= gap.time[1]
    store.outbox.acknowledge([(1, 0, 3)])
    assert store.outbox.usage()[:2] == store.flash.level() == (0, 0)
    assert usage[0] == 4


def test_lost_record_is_counted_once(store: Store, path: Path) -> None:
    store.fill(3)
    change(path, "UPDATE message SET body = x'00' WHERE sequence = 1")
    assert len(store.gaps()) == len(store.gaps()) == 1
    store.fill(1)
    store.flash.close()
    again = Store(path)
    assert again.outbox.usage()[3] == 1
    again.fill(1)
    assert (again.flash.gaps(), len(again.gaps())) == (1, 1)
    again.flash.close()


def test_radio_is_handed_the_gap_and_all_others(store: Store, path: Path) -> None:
    said = store.fill(3)
    change(path, "UPDATE message SET body = zeroblob(99) WHERE sequence = 0")
    store.outbox.connect(0)
    assert [kept.position for kept in store.outbox.due(0, 9)] == said


def test_lost_record_gives_way_like_another(path: Path) -> None:
    small = Store(path, 30_000)
    said = small.fill(20)
    change(path, "UPDATE message SET body = x'00' WHERE sequence = 0")
    said += small.fill(20)
    kept = set(small.positions())
    assert said[0] not in kept
    assert sum(gap.messages for gap in small.gaps()) == len([p for p in said if p not in kept])
    assert small.outbox.usage()[:2] == small.flash.level()
    small.flash.close()


def test_another_key_or_node_is_refused_with_remedy_and_harms_nothing(
    store: Store, path: Path
) -> None:
    said = store.fill(2)
    store.flash.close()
    for other in ({"key": bytes(32)}, {"node": "palm"}):
        with pytest.raises(FlashError, match=r"another key, or for another node.*keys\.directory"):
            open_flash(path, **other)
    again = Store(path)
    assert again.positions() == said
    assert again.gaps() == []
    again.flash.close()


@pytest.mark.parametrize("damage", ["DELETE FROM key_check", "UPDATE key_check SET body = x'00'"])
def test_damaged_key_check_is_written_again(store: Store, path: Path, damage: str) -> None:
    said = store.fill(2)
    store.flash.close()
    change(path, damage)
    change(path, "UPDATE message SET body = x'00' WHERE sequence = 0")
    again = Store(path)
    assert (again.positions(), len(again.gaps())) == (said, 1)
    again.flash.close()
    open_flash(path).close()


def test_damaged_answer_is_a_clear_error_and_a_damaged_charge_unknown(
    store: Store, path: Path
) -> None:
    store.flash.store_answer(SECRET)
    store.flash.store_charge(SECRET)
    for table in ("answer", "charge"):
        change(path, f"UPDATE {table} SET body = zeroblob(80)")  # noqa: S608 - our own words
    with pytest.raises(FlashError, match=r"flash\.sqlite.*last result of fingertip.*bring back"):
        store.flash.answer()
    assert store.flash.charge() == b""


def test_flash_of_another_format_is_refused(path: Path) -> None:
    open_flash(path).close()
    change(path, "PRAGMA user_version = 9")
    with pytest.raises(FlashError, match="format 9"):
        open_flash(path)


def test_key_is_made_at_the_first_start_and_is_the_node_s_alone(tmp_path: Path) -> None:
    design = designs.settings(tmp_path)
    open_as_set(design).close()
    files = sorted((tmp_path / "keys").iterdir())
    assert [file.name for file in files] == [".writer.lock", "fingertip.flash", "master.key"]
    assert {file.stat().st_mode & 0o777 for file in files} == {0o600}
    held = files[1].read_bytes()
    open_as_set(design).close()
    assert files[1].read_bytes() == held
    files[1].unlink()
    with pytest.raises(FlashError, match="another key"):
        open_as_set(design)
