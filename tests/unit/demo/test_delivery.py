"""The audit excuses what never came to be in flash, and nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.removal import RemovalReason, Sweep, remove
from eskin_cloud.store.schema.tables import blocks
from eskin_sensor_node.node.ground_truth import GroundTruth, TrueBlock
from sqlalchemy import delete

from eskin.demo.audit.delivery import Delivery, Sightings, UnderWay, deliveries
from eskin.wire.messages import Position
from tests.unit.cloud.clouds import Clock, put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, block

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store(tmp_path / "store.sqlite", clock=Clock(START)) as opened:
        yield opened


def audited(
    store: Store,
    folder: Path,
    *,
    made: int,
    settled: int,
    ended: int | None,
    stored: range,
) -> Delivery:
    """Where the blocks of boot 1 are, of which the cloud stored some."""
    path = folder / "truth.sqlite"
    truth = GroundTruth(path, limit=1 << 20)
    values = np.ones(1)
    truths = [TrueBlock(Position(1, k), CHANNEL, START, DT, values) for k in range(made)]
    truth.store({NODE: truths}, {NODE: (1, settled)})
    truth.close()
    if stored:
        put(store, *(block(number) for number in stored))
    seen = UnderWay(
        {NODE: path},
        GroundTruth.made(path),
        GroundTruth.settled(path),
        {} if ended is None else {NODE: {1: ended}},
        {NODE: Sightings()},
        [],
    )
    with store.read() as connection:
        (found,) = deliveries(seen, connection, {})
    return found


@pytest.mark.parametrize(
    ("settled", "ended", "unborn", "missing"),
    [
        (80, 89, 10, range(10, 90)),  # flash held up to 89: what was acknowledged is lost
        (80, None, 20, range(10, 80)),  # flash is gone, and the emulator had seen 80 in it
        (0, None, 90, range(0)),  # killed before anything came to be in flash
        (80, 40, 0, range(10, 100)),  # an older flash: it excuses nothing
    ],
)
def test_only_what_never_was_in_flash_is_excused(
    store: Store, tmp_path: Path, settled: int, ended: int | None, unborn: int, missing: range
) -> None:
    found = audited(store, tmp_path, made=100, settled=settled, ended=ended, stored=range(10))
    assert (found.stored, found.unborn) == (10, unborn)
    assert [each.sequence for each in found.missing] == list(missing)
    assert found.passes is not bool(missing)


def test_what_was_removed_by_age_has_not_vanished(store: Store, tmp_path: Path) -> None:
    put(store, *(block(number) for number in range(6)))
    sweep = Sweep(NODE, CHANNEL, RemovalReason.AGE, START + DT)
    removed = store.write(lambda c: remove(c, store.cache, sweep, most=4, now=START)).result(60)
    found = audited(store, tmp_path, made=6, settled=6, ended=5, stored=range(0))
    assert (found.removed, found.stored) == (removed, 6 - removed)
    assert removed
    assert found.passes


def test_more_than_was_removed_has_vanished(store: Store, tmp_path: Path) -> None:
    put(store, *(block(number) for number in range(6)))
    sweep = Sweep(NODE, CHANNEL, RemovalReason.AGE, START + DT)
    store.write(lambda c: remove(c, store.cache, sweep, most=2, now=START)).result(60)
    store.write(lambda c: c.execute(delete(blocks))).result(60)
    found = audited(store, tmp_path, made=6, settled=6, ended=5, stored=range(0))
    assert not found.passes
