"""The audit fails where an interval does not hold the truth, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from eskin.demo.audit import ChannelAudit, audit
from eskin.demo.layout import Layout
from eskin.errors import AuditError
from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.messages import Block, Encoding, Position


def block_around(truth: np.ndarray[tuple[int], np.dtype[np.float64]], *, coverage: float) -> Block:
    tube = Tube((0, 10), 1, Interval.around(truth, 0.5), "F", coverage)
    return Block.pack(Position(1, 1), "t01.capacitance", 0, tube, Encoding.Q16)


def test_truth_inside_passes_with_its_width() -> None:
    truth = np.linspace(0.0, 5.0, 100)
    entry = ChannelAudit("n", "t01.capacitance", "F")
    entry.compare(block_around(truth, coverage=1.0), 5, truth)
    assert entry.passes
    assert (entry.samples, entry.violations) == (100, 0)
    assert entry.mean_width == pytest.approx(1.0, rel=1e-3)


def test_one_violation_under_bounded_noise_fails() -> None:
    truth = np.linspace(0.0, 5.0, 100)
    entry = ChannelAudit("n", "t01.capacitance", "F")
    block = block_around(truth, coverage=1.0)
    truth[7] += 0.6
    entry.compare(block, 5, truth)
    assert entry.violations == 1
    assert not entry.passes


def test_violations_within_chance_pass_and_beyond_it_fail() -> None:
    truth = np.zeros(1000)
    block = block_around(truth, coverage=0.99)
    for wrong, passes in ((25, True), (40, False)):
        entry = ChannelAudit("n", "t01.capacitance", "F")
        moved = truth.copy()
        moved[:wrong] = 1.0
        entry.compare(block, 5, moved)
        assert entry.violations == wrong
        assert entry.passes is passes


def test_time_outside_its_enclosure_fails() -> None:
    truth = np.zeros(10)
    entry = ChannelAudit("n", "t01.capacitance", "F")
    entry.compare(block_around(truth, coverage=1.0), 11, truth)
    assert entry.late == 1
    assert not entry.passes


def test_unbounded_samples_hold_but_have_no_width() -> None:
    tube = Tube((0, 10), 1, Interval([1.0, 2.0], [np.inf, 3.0]), "F", 1.0)
    block = Block.pack(Position(1, 1), "t01.capacitance", 0, tube, Encoding.F64)
    entry = ChannelAudit("n", "t01.capacitance", "F")
    entry.compare(block, 5, np.array([1e9, 2.5]))
    assert entry.passes
    assert (entry.unbounded, entry.bounded) == (1, 1)
    assert entry.mean_width == pytest.approx(1.0)


def test_wrong_label_fails() -> None:
    truth = np.zeros(10)
    entry = ChannelAudit("n", "t01.capacitance", "F")
    entry.compare(block_around(truth, coverage=1.0), 5, truth)
    assert entry.passes
    entry.mislabelled += 1
    assert not entry.passes


def test_folder_without_a_store_is_named(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("empty")
    with pytest.raises(AuditError, match="no store here"):
        audit(Layout(folder))
