"""Mosquitto is found where there is one that our configuration is for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from eskin.mosquitto import find_mosquitto

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("says", "is_used"),
    [
        ("mosquitto version 2.0.11", True),
        ("mosquitto version 1.6.9", False),
        ("mosquitto version 3.0.0", False),
        ("permission denied", False),
    ],
)
def test_only_version_2_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, says: str, *, is_used: bool
) -> None:
    program = tmp_path / "mosquitto"
    program.write_text(f"#!/bin/sh\necho '{says}'\nexit 3\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    assert find_mosquitto() == (program if is_used else None)


def test_program_that_cannot_be_run_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "mosquitto"
    program.write_bytes(b"\x7fELF")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_mosquitto() is None
