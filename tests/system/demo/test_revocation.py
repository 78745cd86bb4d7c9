"""A client that was revoked is out within seconds, stays out, and the others go on."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import pytest

from tests.support.demos import RunningDemo
from tests.support.processes import ESKIN, free_port, wait_until

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.nightly


@pytest.mark.timeout(600)
@pytest.mark.parametrize("broker", [[], ["--embedded-broker"]], ids=["mosquitto", "embedded"])
def test_revoked_node_is_out_and_stays_out(tmp_path: Path, broker: list[str]) -> None:
    data = tmp_path / "data"
    with RunningDemo(data, "--nodes", "2", "--speed", "0.25", *broker) as demo:
        demo.wait_for_more(["fingertip", "palm"])
        revoke = [ESKIN, "pki", "revoke", "--dir", str(data / "ca"), "--name", "palm"]
        subprocess.run(revoke, check=True, capture_output=True, timeout=120)

        def is_out() -> bool:
            """Whether nothing of it comes while others' comes; some may have been under way."""
            before = demo.samples()
            demo.wait_for_more(["fingertip"])
            return demo.samples()["palm"] == before["palm"]

        wait_until(is_out, "no more of it comes")
        before = demo.samples()
        demo.wait_for_more(["fingertip"])
        assert demo.samples()["palm"] == before["palm"]
        assert demo.stop() == 0
        demo.start()
        demo.wait_for(
            lambda: "palm was revoked, so it is kept out" in demo.output(),
            "it is notified of who is out",
        )
        demo.wait_for_more(["fingertip"])
        assert demo.samples()["palm"] == before["palm"]
        assert demo.stop() == 0
        assert "Traceback" not in (data / "logs" / "broker.log").read_text()


@pytest.mark.timeout(600)
def test_demo_says_which_of_its_own_parts_was_revoked(tmp_path: Path) -> None:
    data = tmp_path / "data"
    argv = [ESKIN, "demo", "--nodes", "1", "--data", str(data), "--port", str(free_port())]
    first = subprocess.run(
        [*argv, "--duration", "0.1"], capture_output=True, text=True, timeout=250, check=False
    )
    assert first.returncode == 0, first.stderr
    revoke = [ESKIN, "pki", "revoke", "--dir", str(data / "ca"), "--name", "gateway.demo"]
    subprocess.run(revoke, check=True, capture_output=True, timeout=120)
    again = subprocess.run(argv, capture_output=True, text=True, timeout=200, check=False)
    assert again.returncode == 2
    assert "gateway.demo was revoked" in again.stderr
