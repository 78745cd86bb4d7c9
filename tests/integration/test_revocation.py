"""Whoever was revoked is out within seconds, stays out, and the others go on."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import pytest

from tests.demos import RunningDemo
from tests.processes import ESKIN, wait_until

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.timeout(200)
def test_revoked_node_is_out_and_stays_out(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with RunningDemo(data, "--nodes", "2") as demo:
        demo.wait_for_more(["fingertip", "palm"])
        revoke = [ESKIN, "pki", "revoke", "--dir", str(data / "ca"), "--name", "palm"]
        subprocess.run(revoke, check=True, capture_output=True, timeout=30)
        broker = data / "logs" / "broker.log"
        wait_until(lambda: "ended: client=" in broker.read_text(), "the broker ends it", seconds=5)
        demo.wait_for_more(["fingertip"])
        before = demo.samples()
        demo.wait_for_more(["fingertip"])
        assert demo.samples()["palm"] == before["palm"]
        assert demo.stop(seconds=60) == 0
        demo.start()
        assert "palm was revoked, so it is kept out" in demo.output()
        demo.wait_for_more(["fingertip"])
        assert demo.samples()["palm"] == before["palm"]
        assert demo.stop(seconds=60) == 0
