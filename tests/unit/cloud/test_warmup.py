"""What a cloud does with its first frames is loaded before they come."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path


def loaded(place: Path, *how: str) -> set[str]:
    command = [sys.executable, "-m", "tests.unit.cloud.first_use", str(place), *how]
    stated = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(stated.stdout.split())


@pytest.mark.nightly
def test_first_messages_load_nothing_after_the_warm_up(tmp_path: Path) -> None:
    cold = loaded(tmp_path / "cold.sqlite")
    assert {
        "_encode_all",
        "_decode_all",
        "_decode_records",
        "fold_samples",
        "fold_pieces",
        "divide_down",
        "_scan",
        "_fit",
    } <= cold
    assert loaded(tmp_path / "warm.sqlite", "warm") == set()
