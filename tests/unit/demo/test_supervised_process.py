"""A process of the demo that dies is started again, later and later while it does no good."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import TYPE_CHECKING

from eskin.demo.supervised_process import SupervisedProcess
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def test_pauses_grow_with_each_death_until_it_has_run_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING, "eskin.demo.supervised_process")
    now = 1000.0
    monkeypatch.setattr(
        "eskin.demo.supervised_process.time", SimpleNamespace(monotonic=lambda: now)
    )
    child = SupervisedProcess("cloud", ["false"], log_file=tmp_path / "log")
    for ran, pause in [(1.0, 0.5), (1.0, 1.0), (1.0, 2.0), (61.0, 0.5), (1.0, 1.0)]:
        if child._process is None:
            child.start()
        wait_until(lambda: child.pid is None, "it has ended")
        now += ran
        child.keep_alive()
        assert caplog.messages[-1] == f"cloud ended with status 1; again in {pause:.1f} s"
        now += pause - 0.1
        child.keep_alive()
        assert child.pid is None
        now += 0.2
        before = child._process
        child.keep_alive()
        assert child._process is not before
    child.stop()
