"""The command says what is wrong in one clear line, with status 2."""

from __future__ import annotations

import re
import subprocess
from typing import TYPE_CHECKING

import pytest

from sensor_node.profile import Profile
from tests.processes import ESKIN

if TYPE_CHECKING:
    from pathlib import Path

COMMANDS = ["demo", "audit", "node", "gateway", "cloud", "pki", "pki enrol", "cloud login"]


def run(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [ESKIN, *arguments], capture_output=True, text=True, timeout=60, check=False, cwd=cwd
    )


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_is_everywhere(command: str) -> None:
    done = run(*command.split(), "--help")
    assert done.returncode == 0
    assert "Usage: eskin" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["node"], "config"),
        (["frobnicate"], "frobnicate"),
        (["demo", "--nodes", "0"], "0"),
        (["demo", "--port", "many"], "many"),
        (["demo", "--speed", "nan", "--bogus"], "bogus"),
        (["audit", "--data", "/nonexistent"], "/nonexistent"),
        (["gateway", "--config", "/nonexistent.toml"], "/nonexistent.toml cannot be read"),
        (["pki", "issue", "--dir", "x", "--kind", "robot", "--name", "n", "--out", "o"], "robot"),
    ],
)
def test_bad_usage_is_one_line_and_status_2(arguments: list[str], words: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert "Traceback" not in done.stderr


_FINGERTIP = Profile.read("fingertip").text
NODE = """
[node]
name = "fingertip"
profile = "fingertip"
[identity]
directory = "x"
site = "x"
[flash]
path = "x"
[truth]
path = "x"
"""
GATEWAY = """
[identity]
directory = "x"
site = "x"
[spool]
path = "x"
"""
CLOUD = """
[store]
path = "x"
[gateways]
identity = "x"
"""
TAXEL = re.sub(r"capacitance_min_F = \S+", "capacitance_min_F = 1.0", _FINGERTIP)


@pytest.mark.parametrize(
    ("process", "text", "words"),
    [
        ("node", NODE + "[broker]\nprot = 1\n", ["broker.prot", "no such setting"]),
        ("node", NODE + '[broker]\nport = "x"\n', ["broker.port", "'x'"]),
        ("node", NODE + TAXEL, ["taxel.0", "capacitance"]),
        ("node", NODE.replace('"fingertip"', '"a.b"', 1), ["node.name", "'a.b'"]),
        ("gateway", GATEWAY + "[http]\nport = 70000\n", ["http.port", "70000"]),
        ("gateway", GATEWAY + '[http]\nhost = "0.0.0.0"\n', ["http.host", "loopback"]),
        ("gateway", GATEWAY + "[bogus]\nx = 1\n", ["bogus", "no such setting"]),
        ("gateway", GATEWAY, ["x/key.pem"]),
        ("cloud", CLOUD + "[people]\nport = 1.5\n", ["people.port", "1.5"]),
        ("cloud", CLOUD + '[people]\nhost = "0.0.0.0"\n', ["people", "loopback"]),
        ("cloud", "[store]\n", ["store.path", "is missing"]),
        ("cloud", CLOUD.replace("[store]", "[sotre]"), ["store"]),
    ],
)
def test_bad_configuration_is_one_line_and_status_2(
    tmp_path: Path, process: str, text: str, words: list[str]
) -> None:
    config = tmp_path / "config.toml"
    config.write_text(text)
    done = run(process, "--config", str(config), cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert all(word in done.stderr for word in words), done.stderr
    assert len(done.stderr.splitlines()) == 1
