"""The command says what is wrong in one clear line, with status 2."""

from __future__ import annotations

import subprocess

import pytest

from tests.processes import ESKIN

COMMANDS = ["demo", "audit", "node", "gateway", "cloud", "pki", "pki enrol", "cloud login"]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [ESKIN, *arguments], capture_output=True, text=True, timeout=60, check=False
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
