from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.node.ground_truth import GroundTruth, TrueFrame

from eskin.errors import FlashError
from eskin.wire.messages import Position

if TYPE_CHECKING:
    from pathlib import Path


PERIOD = 1_000_000


def true(sequence: int, n: int = 250, *, boot: int = 1, time: int = 10**18) -> TrueFrame:
    """The truth behind a frame of one patch with so many samples."""
    values = np.random.default_rng(sequence).normal(size=n)
    sizes = np.array([[0, n]], np.uint32)
    begin, lasting = time + sequence, n * PERIOD
    place = Position(boot, sequence)
    return TrueFrame(place, bytes(32), sequence, lasting, begin, begin + lasting, sizes, values)


def test_truth_is_read_back_as_it_was_while_open_for_writing(tmp_path: Path) -> None:
    path = tmp_path / "truth.sqlite"
    truth = GroundTruth(path, limit=1 << 20)
    assert GroundTruth.oldest(path) is None
    truth.store({"n": [true(3), true(5)]})
    found = GroundTruth.read_frames(
        path, [Position(1, 3), Position(1, 4), Position(1, 5)], node="n"
    )
    assert sorted(found) == [Position(1, 3), Position(1, 5)]
    kept, made = found[Position(1, 5)], true(5)
    for name in ("position", "layout", "ticks", "lasting", "time", "end"):
        assert getattr(kept, name) == getattr(made, name)
    assert np.array_equal(kept.sizes, made.sizes)
    assert np.array_equal(kept.values, made.values)
    truth.close()


def test_oldest_truth_gives_way_beyond_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "truth.sqlite"
    truth = GroundTruth(path, limit=1 << 18)
    for sequence in range(400):
        truth.store({"n": [true(sequence)]})
    found = GroundTruth.read_frames(
        path, [Position(1, sequence) for sequence in range(400)], node="n"
    )
    assert max(found) == Position(1, 399)
    assert 40 < len(found) < 140
    assert min(found).sequence == 400 - len(found)
    assert GroundTruth.oldest(path) == min(found)
    truth.close()


def test_seed_is_kept_when_none_is_wanted(tmp_path: Path) -> None:
    first = GroundTruth(tmp_path / "truth.sqlite", limit=1 << 20)
    drawn = first.seed(None)
    first.close()
    again = GroundTruth(tmp_path / "truth.sqlite", limit=1 << 20)
    assert again.seed(None) == drawn
    assert again.seed(41) == 41
    assert again.seed(None) == 41
    again.close()
    other = GroundTruth(tmp_path / "other.sqlite", limit=1 << 20)
    assert other.seed(None) != drawn
    other.close()


def test_missing_truth_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(FlashError, match="cannot be read"):
        GroundTruth.read_frames(tmp_path / "none.sqlite", [Position(1, 1)], node="n")


def test_end_is_after_the_latest_sample_of_the_latest_boot(tmp_path: Path) -> None:
    truth = GroundTruth(tmp_path / "truth.sqlite", limit=1 << 20)
    assert truth.end() is None
    truth.store({"n": [true(3), true(5, n=100)], "other": [true(4)]})
    assert truth.end() == 10**18 + 4 + 250 * PERIOD
    truth.store({"n": [true(0, n=10, boot=2, time=9 * 10**17)]})
    assert truth.end() == 10**18 + 4 + 250 * PERIOD
    truth.close()


def test_second_node_on_one_truth_is_refused(tmp_path: Path) -> None:
    first = GroundTruth(tmp_path / "truth.sqlite", limit=1 << 20)
    with pytest.raises(FlashError, match="another process writes this truth"):
        GroundTruth(tmp_path / "truth.sqlite", limit=1 << 20)
    first.close()


def test_nodes_of_one_file_are_distinguished(tmp_path: Path) -> None:
    path = tmp_path / "truth.sqlite"
    truth = GroundTruth(path, limit=1 << 20)
    truth.store({"a": [true(3), true(4, n=9)], "b": [true(4), true(7)]})
    truth.close()
    assert GroundTruth.made(path) == {
        "a": [Position(1, 3), Position(1, 4)],
        "b": [Position(1, 4), Position(1, 7)],
    }
    for node, samples in (("a", 9), ("b", 250)):
        found = GroundTruth.read_frames(path, [Position(1, 3), Position(1, 4)], node=node)
        assert len(found[Position(1, 4)].values) == samples
        assert (Position(1, 3) in found) == (node == "a")
    assert GroundTruth.oldest(path, node="b") == Position(1, 4)
    assert GroundTruth.oldest(path, node="c") is None
