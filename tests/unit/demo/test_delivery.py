"""The audit excuses what never came to be in flash, and nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_cloud.store import Store
from eskin_sensor_node.node.ground_truth import GroundTruth, TrueFrame

from eskin.demo.audit.delivery import Delivery, Sightings, UnderWay, deliveries
from eskin.demo.audit.frames import audit_frames
from eskin.wire.messages import Position
from tests.unit.cloud.clouds import Clock
from tests.unit.cloud.messages import NODE, START
from tests.unit.cloud.skins import HAND, PATCHES, bring_all, describe, frame

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
    """Where the frames of boot 1 are, of which the cloud stored some."""
    path = folder / "truth.sqlite"
    truth = GroundTruth(path, limit=1 << 20)
    sizes, values = np.array([[0, 15], [1, 1]], np.uint32), np.ones(16)
    end = START + 20_000_000
    truths = [
        TrueFrame(Position(1, k), HAND.content_hash, 0, end - START, START, end, sizes, values)
        for k in range(made)
    ]
    truth.store({NODE: truths}, {NODE: (1, settled)})
    truth.close()
    if stored:
        describe(store, *PATCHES, HAND)
        bring_all(store, *((NODE, frame(number)) for number in stored))
    seen = UnderWay(
        {NODE: path},
        GroundTruth.made(path),
        GroundTruth.settled(path),
        {} if ended is None else {NODE: {1: ended}},
        {NODE: Sightings()},
        [],
        {},
    )
    with store.read() as connection:
        framed = audit_frames(path, connection, NODE, lambda _rows: None, reader=None)
        (found,) = deliveries(seen, connection, {NODE: framed})
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
