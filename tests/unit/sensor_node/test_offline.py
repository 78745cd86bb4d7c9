"""A node that lives for a while on a chip that is thrown away."""

from __future__ import annotations

import logging
import tempfile
from typing import TYPE_CHECKING

from eskin_sensor_node.node.offline import offline_node, warm_up

from tests.unit.sensor_node.designs import SECOND, settings, waiting

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def test_it_reports_its_samples_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "scratch"))
    given = settings(tmp_path, "palm")
    with offline_node(given) as offline:
        offline.run_until(2 * SECOND)
        assert len(list(waiting(offline.flash))) > 4
        assert offline.outbox.messages > 4
    assert list((tmp_path / "scratch").iterdir()) == []
    assert not given.flash.path.exists()


def test_node_starts_without_warm_up_where_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    with caplog.at_level(logging.WARNING):
        warm_up(settings(tmp_path, "palm"))
    assert "warm-up skipped" in caplog.text
