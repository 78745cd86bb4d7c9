"""The audit of frames finds what a store has lost, doubled or changed, compacted or not."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.damage import FrameHeader
from eskin_cloud.store.removal import PatchSweep, remove, remove_rows
from eskin_cloud.store.schema.frame_tables import frames, patch_rows
from eskin_cloud.store.schema.sealed_tables import erased_subjects, removals, sealed_messages
from eskin_cloud.store.write.removal_counts import RemovalReason, Sweep
from eskin_sensor_node.columns.stretch import PatchColumns
from eskin_sensor_node.node.ground_truth import GroundTruth
from sqlalchemy import delete, insert, select, update
from typer.testing import CliRunner

from eskin.cli import app
from eskin.demo.audit import Audit, audit
from eskin.demo.layout import DemoFolder
from eskin.privacy import Encryptor, FileMasterKey, KeyStore
from eskin.privacy.master_key import MASTER_FILE
from eskin.privacy.sealed_message import name_place
from eskin.wire.frames import EncodedFrame, Layout, Patch, Privacy
from eskin.wire.messages import Position
from tests.support.identities import SITE
from tests.unit.cloud.clouds import Clock
from tests.unit.cloud.skins import bring_all, describe
from tests.unit.sensor_node.designs import SECOND, START
from tests.unit.sensor_node.skin_node.benches import PATCHES, SkinBench, TinyColumns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from eskin_sensor_node.firmware.chip import StoredMessage
    from sqlalchemy import Connection

NODE = "paper-hand"
STRETCHES = 250
WAITING = 6
"""Messages that no gateway has acknowledged."""


HEART = Patch("heart", "bioelectric", "V", ("t4",), 64.0, Privacy.BIOMETRIC, "wearer")


class WornColumns(TinyColumns):
    """The same skin, but its second page is about a person."""

    patches = (*PATCHES[:2], HEART)
    layout = Layout(tuple(patch.content_hash for patch in patches), pages=(2, 1))


class SharingColumns(TinyColumns):
    """The same skin, whose air has one factor in all samples."""

    alpha = 0.9, 1.1
    factors: tuple[float, ...] = (1.05,)
    patches = (
        replace(PATCHES[0], least_width=2.0**-10, alpha=(alpha,), beta=((0.0, 0.0),)),
        *PATCHES[1:],
    )
    layout = Layout(tuple(patch.content_hash for patch in patches), pages=(2, 1))

    def _patch(self, number: int, grid: int, shape: tuple[int, int]) -> PatchColumns:
        if number:
            return super()._patch(number, grid, shape)
        own = 10.0 + 30.0 * self._random.random(shape)
        truth = own * self.factors[self.stretches % len(self.factors)]
        lo, hi = self.alpha[0] * (own - 0.01), self.alpha[1] * (own + 0.01)
        return PatchColumns(number, grid, 1, lo, hi, truth)


class DriftingColumns(SharingColumns):
    """Its factor is another one in each stretch, and always within its bounds."""

    factors = (1.04, 1.06)


class Said(NamedTuple):
    """A message as it waited in flash."""

    body: bytes

    def encode(self) -> bytes:
        return self.body


class Demo:
    """What is left of a demo of one node.

    Args:
        root: Its folder.
        build: The node's columns.
        sections: Changes of the node's settings.
    """

    def __init__(self, root: Path, build: type[TinyColumns] = TinyColumns, **sections: Any) -> None:
        self.folder = DemoFolder(root)
        self.build = build
        own = self.folder.node(NODE)
        own.mkdir(parents=True)
        self.folder.store.parent.mkdir()
        bench = SkinBench(own, build=build, **sections)
        bench.run_to(STRETCHES / 10)
        self.store = Store(self.folder.store, clock=Clock(START + 3600 * SECOND))
        describe(self.store, *build.patches, build.layout, node=NODE)
        messages = bench.waiting()[:-WAITING]
        bring_all(self.store, *((NODE, Said(body)) for body in self.delivered(messages)))
        last = messages[-1].position
        bench.outbox.acknowledge([(last[0], 0, last[1])])
        self.made = GroundTruth.made(self.folder.truth(NODE))[NODE]
        bench.close()

    def delivered(self, messages: list[StoredMessage]) -> Iterator[bytes]:
        """What a gateway brings of a node's messages."""
        return (kept.body for kept in messages)

    def change(self, work: Callable[[Connection], object]) -> None:
        """Change the store behind its back."""
        self.store.write(lambda connection: (work(connection), None)[1]).result(60)

    def compact(self) -> None:
        """Compact all frames."""
        due = Due(2**62, 2**62)
        for page in find_compactable_frames(self.store, due):
            while compact_frames(self.store, page, due):
                pass

    def rewrite(self, **changes: Any) -> None:
        """Change the truth behind the third frame."""
        path = self.folder.truth(NODE)
        place = self.made[2]
        true = GroundTruth.read_frames(path, [place], node=NODE)[place]
        truth = GroundTruth(path, limit=2**30)
        truth.store({NODE: [replace(true, **changes)]})
        truth.close()

    def audit(self) -> Audit:
        return audit(self.folder)


class Worn(Demo):
    """A demo whose gateway sealed the frames of a heart."""

    def __init__(self, root: Path) -> None:
        super().__init__(root, WornColumns)

    def delivered(self, messages: list[StoredMessage]) -> Iterator[bytes]:
        keys = self.folder.keys
        self.ada = KeyStore(keys, FileMasterKey(keys / MASTER_FILE)).create("Ada Lovelace")
        self.place = name_place((WornColumns.layout.content_hash, 1))
        encryptor = Encryptor()
        for body in super().delivered(messages):
            frame = EncodedFrame.decode(body)
            sealed = encryptor.encrypt(self.ada, NODE, frame, body)
            yield sealed.encode() if frame.page == 1 else body

    def remove(self, reason: RemovalReason, before: int) -> None:
        """Remove sealed frames."""
        sweep = Sweep(NODE, self.place, reason, before)
        now = START + 3600 * SECOND
        work = partial(remove, sweep=sweep, most=10**6, now=now)
        self.store.write_node(NODE, work).result(60)


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[Demo]:
    made = Demo(tmp_path)
    yield made
    made.store.close()


@pytest.fixture
def worn(tmp_path: Path) -> Iterator[Worn]:
    made = Worn(tmp_path)
    with closing(made.store):
        yield made


def totals(found: Audit) -> dict[str, tuple[int, int, int]]:
    return {e.channel: (e.samples, e.violations, e.unbounded) for e in found.channels}


def test_all_samples_are_compared_by_patch_also_when_compacted(demo: Demo) -> None:
    found = demo.audit()
    assert found.passes
    stored = STRETCHES - WAITING // 2
    samples = {name: counts[0] for name, counts in totals(found).items()}
    assert samples == {
        "air.temperature": stored,
        "palm.pressure": 15 * stored,
        "thumb.pressure": 5 * stored,
    }
    assert all(0 < entry.unbounded < entry.samples / 10 for entry in found.channels[1:])
    (delivery,) = found.deliveries
    assert (delivery.made, delivery.stored) == (2 * STRETCHES, 2 * STRETCHES - WAITING)
    assert delivery.waiting == WAITING
    demo.compact()
    with demo.store.read() as connection:
        assert connection.execute(select(frames)).all() == []
    again = demo.audit()
    assert again.passes
    assert totals(again) == totals(found)
    assert again.deliveries == found.deliveries
    for one, other in zip(found.channels, again.channels, strict=True):
        assert one.mean_width == pytest.approx(other.mean_width)
        assert one.coverage == other.coverage


@pytest.mark.parametrize("compacted", [False, True])
def test_value_outside_its_interval_is_found(demo: Demo, *, compacted: bool) -> None:
    if compacted:
        demo.compact()
    true = GroundTruth.read_frames(demo.folder.truth(NODE), [demo.made[2]], node=NODE)
    values = true[demo.made[2]].values.copy()
    values[0] += 1e5
    demo.rewrite(values=values)
    found = demo.audit()
    assert not found.passes
    assert {e.channel: e.violations for e in found.channels if e.violations} == {
        "air.temperature": 1
    }


def test_departures_are_listed_and_their_violations_count(demo: Demo) -> None:
    assert demo.audit().departures == {}
    truth = GroundTruth(demo.folder.truth(NODE), limit=2**30)
    truth.store_departures(NODE, ["t05: worn from 2 s"])
    truth.close()
    assert demo.audit().passes  # nothing was violated
    values = GroundTruth.read_frames(demo.folder.truth(NODE), [demo.made[2]], node=NODE)
    demo.rewrite(values=values[demo.made[2]].values + 1e5)
    found = demo.audit()
    assert found.departures == {NODE: ["t05: worn from 2 s"]}
    assert not found.passes
    shown = CliRunner().invoke(app, ["audit", "--data", str(demo.folder.root)])
    assert shown.exit_code == 1
    assert f"{NODE}: beyond its data sheet: t05: worn from 2 s" in shown.output


@pytest.mark.parametrize("compacted", [False, True])
@pytest.mark.parametrize("instant", ["time", "end"])
def test_instant_outside_its_enclosure_is_found(
    instant: str, demo: Demo, *, compacted: bool
) -> None:
    if compacted:
        demo.compact()
    true = GroundTruth.read_frames(demo.folder.truth(NODE), [demo.made[2]], node=NODE)
    demo.rewrite(**{instant: getattr(true[demo.made[2]], instant) + SECOND})
    found = demo.audit()
    assert not found.passes
    assert {e.channel: e.late for e in found.channels if e.late} == {
        "air.temperature": 1,
        "palm.pressure": 1,
    }


def test_missing_frame_is_found(demo: Demo) -> None:
    demo.change(lambda db: db.execute(delete(frames).where(frames.c.sequence == 7)))
    (delivery,) = demo.audit().deliveries
    assert delivery.missing == (Position(1, 7),)


def test_missing_row_of_one_patch_is_found(demo: Demo) -> None:
    demo.compact()
    rows = patch_rows.c
    with demo.store.read() as connection:
        query = select(rows.t, rows.frames).where(rows.patch == "palm").order_by(rows.t)
        t, count = connection.execute(query).first() or (0, 0)
    gone = delete(patch_rows).where(rows.patch == "palm", rows.t == t)
    demo.change(lambda db: db.execute(gone))
    found = demo.audit()
    assert not found.passes
    assert len(found.deliveries[0].missing) == count


def test_what_was_removed_by_age_has_not_vanished(demo: Demo) -> None:
    demo.compact()
    now = START + 3600 * SECOND
    for patch in PATCHES[:2]:
        sweep = PatchSweep(NODE, patch.patch_id, patch.channels, now)
        demo.change(partial(remove_rows, sweep=sweep, most=10**6, now=now))
    found = demo.audit()
    assert found.passes
    (delivery,) = found.deliveries
    # All frames of the first page; a row holds those of many seconds.
    assert delivery.removed == STRETCHES - WAITING // 2
    assert delivery.stored + delivery.removed + delivery.waiting == delivery.made
    demo.change(lambda db: db.execute(delete(removals).where(removals.c.place == "palm")))
    assert len(demo.audit().deliveries[0].missing) == delivery.removed


def test_frame_that_is_stored_twice_is_found(demo: Demo) -> None:
    with demo.store.read() as connection:
        rows = [dict(row) for row in connection.execute(select(frames).limit(3)).mappings()]
    demo.compact()
    demo.change(lambda db: db.execute(insert(frames), rows))
    found = demo.audit()
    assert found.doubled == {NODE: [Position(1, 0), Position(1, 1), Position(1, 2)]}
    assert not found.passes


def test_columns_that_are_not_those_of_the_frame_are_found(demo: Demo) -> None:
    with demo.store.read() as connection:
        row = dict(connection.execute(select(frames).limit(1)).mappings().one())
    moved = row | {"t": row["t"] + 1}
    new = {"t": moved["t"], "head": FrameHeader.of(moved).checksum()}
    here = frames.c.sequence == row["sequence"]
    demo.change(lambda db: db.execute(update(frames).where(here).values(new)))
    found = demo.audit()
    assert not found.passes
    assert {e.channel: e.mislabelled for e in found.channels if e.mislabelled} == {
        "air.temperature": 1,
        "palm.pressure": 1,
    }


def test_frames_that_a_full_flash_gave_up_are_reported_as_lost(tmp_path: Path) -> None:
    path = DemoFolder(tmp_path).flash(NODE)
    demo = Demo(tmp_path, flash={"path": path, "capacity_bytes": 2**16})
    found = demo.audit()
    demo.store.close()
    (delivery,) = found.deliveries
    assert delivery.lost > 50
    assert delivery.stored + delivery.waiting + delivery.lost == delivery.made
    assert found.passes


def test_sealed_frames_are_compared(worn: Worn) -> None:
    found = worn.audit()
    assert found.passes
    stored = STRETCHES - WAITING // 2
    assert {name: counts[0] for name, counts in totals(found).items()} == {
        "air.temperature": stored,
        "heart.bioelectric": 5 * stored,
        "palm.pressure": 15 * stored,
    }
    (delivery,) = found.deliveries
    assert (delivery.stored, delivery.waiting) == (2 * STRETCHES - WAITING, WAITING)


def test_value_outside_its_sealed_interval_is_found(worn: Worn) -> None:
    place = worn.made[3]
    path = worn.folder.truth(NODE)
    true = GroundTruth.read_frames(path, [place], node=NODE)[place]
    with closing(GroundTruth(path, limit=2**30)) as truth:
        truth.store({NODE: [replace(true, values=true.values + 1e5, time=true.time + SECOND)]})
    found = worn.audit()
    assert not found.passes
    (entry,) = (each for each in found.channels if not each.passes)
    assert (entry.channel, entry.late) == ("heart.bioelectric", 1)
    assert entry.violations + entry.unbounded >= 5


@pytest.mark.parametrize(("column", "value"), [("t_lo", START + 3600 * SECOND), ("place", "a.b")])
def test_columns_that_do_not_enclose_the_sealed_frame_are_found(
    column: str, value: int | str, worn: Worn
) -> None:
    here = sealed_messages.c.sequence == worn.made[3].sequence
    worn.change(lambda db: db.execute(update(sealed_messages).where(here).values({column: value})))
    found = worn.audit()
    assert {e.channel: e.mislabelled for e in found.channels if e.mislabelled} == {
        "heart.bioelectric": 1
    }
    assert not found.passes


def test_sealed_frame_that_was_changed_is_damaged(worn: Worn) -> None:
    here = sealed_messages.c.sequence == worn.made[3].sequence
    with worn.store.read() as connection:
        data = bytearray(
            connection.execute(select(sealed_messages.c.data).where(here)).scalar_one()
        )
    data[-30] ^= 1
    changed = update(sealed_messages).where(here).values(data=bytes(data))
    worn.change(lambda db: db.execute(changed))
    found = worn.audit()
    assert len(found.damaged) == 1
    assert not found.passes


def test_missing_sealed_frame_is_found(worn: Worn) -> None:
    here = sealed_messages.c.sequence == worn.made[3].sequence
    worn.change(lambda db: db.execute(delete(sealed_messages).where(here)))
    (delivery,) = worn.audit().deliveries
    assert delivery.missing == (worn.made[3],)


@pytest.mark.parametrize("reason", list(RemovalReason))
def test_sealed_frames_that_were_removed_have_not_vanished(
    reason: RemovalReason, worn: Worn
) -> None:
    row = {"site": SITE, "subject": worn.ada.pseudonym, "erased": START}
    worn.change(lambda db: db.execute(insert(erased_subjects), row))
    worn.remove(reason, START + 3600 * SECOND)
    found = worn.audit()
    (delivery,) = found.deliveries
    assert found.passes
    assert delivery.removed == STRETCHES - WAITING // 2
    # More than was removed has vanished.
    fewer = update(removals).values(messages=delivery.removed - 1)
    worn.change(lambda db: db.execute(fewer))
    assert len(worn.audit().deliveries[0].missing) == delivery.removed


def test_frames_of_an_erased_subject_are_not_compared(worn: Worn) -> None:
    keys = worn.folder.keys
    KeyStore(keys, FileMasterKey(keys / MASTER_FILE)).erase(worn.ada.pseudonym)
    found = worn.audit()
    assert found.passes
    assert "heart.bioelectric" not in totals(found)


@pytest.mark.parametrize("compacted", [False, True])
@pytest.mark.parametrize("build", [SharingColumns, DriftingColumns])
def test_shared_error_that_is_not_constant_is_found(
    tmp_path: Path, build: type[SharingColumns], *, compacted: bool
) -> None:
    demo = Demo(tmp_path, build)
    if compacted:
        demo.compact()
    found = demo.audit()
    demo.store.close()
    (air,) = (each for each in found.channels if each.channel == "air.temperature")
    assert air.violations == 0
    assert air.contradictions == (build is DriftingColumns)
    assert found.passes is (build is SharingColumns)
