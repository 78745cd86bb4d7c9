"""The audit of a patch fails where its intervals do not hold the truth, and only there."""

from __future__ import annotations

import math

import pytest

from eskin.demo.audit import ChannelAudit, audit
from eskin.demo.layout import DemoFolder
from eskin.errors import AuditError


def entry(**counts: float) -> ChannelAudit:
    """An entry that keeps its promise, but for what is given."""
    kept = {"frames": 10, "samples": 1000, "width": 1000.0, "magnitude": 5000.0}
    return ChannelAudit("n", "palm.pressure", "Pa", **(kept | counts))  # type: ignore[arg-type]  # of fields


def test_truth_inside_passes_with_its_width() -> None:
    assert entry().passes
    assert (entry().mean_width, entry().relative_width) == (1.0, 0.2)


@pytest.mark.parametrize("wrong", ["violations", "late", "mislabelled"])
def test_one_broken_promise_fails(wrong: str) -> None:
    assert not entry(**{wrong: 1}).passes


def test_violations_within_chance_pass_and_beyond_it_fail() -> None:
    assert entry(coverage=0.99, violations=25).passes
    assert not entry(coverage=0.99, violations=40).passes


def test_unbounded_samples_hold_but_have_no_width() -> None:
    found = entry(unbounded=500)
    assert found.passes
    assert (found.bounded, found.mean_width) == (500, 2.0)
    assert math.isnan(entry(unbounded=1000).mean_width)


def test_sums_of_two_layouts_are_added() -> None:
    found = entry(coverage=0.99, violations=20)
    found.add(entry(violations=5))
    assert (found.frames, found.samples, found.violations, found.coverage) == (20, 2000, 25, 0.99)


def test_folder_without_a_store_is_named(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("empty")
    with pytest.raises(AuditError, match="no store here"):
        audit(DemoFolder(folder))
