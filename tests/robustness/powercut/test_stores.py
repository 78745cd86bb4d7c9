"""A store that was cut off from power at any byte opens again with all that was acknowledged."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.robustness.powercut.cuts import cut
from tests.robustness.powercut.journal import record
from tests.robustness.powercut.stores import STORES

if TYPE_CHECKING:
    from pathlib import Path

IMAGES = {"flash": 12, "spool": 25, "store": 6}


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("powercut") / "live"
    folder.mkdir()
    return folder, record(folder, seed=1)


@pytest.mark.parametrize("name", STORES)
def test_power_cut_at_any_byte_loses_nothing_acknowledged(
    name: str, journal: tuple[Path, Path]
) -> None:
    folder, file = journal
    cuts = list(cut(name, folder / name, file, images=IMAGES[name], seed=1))
    assert len(cuts) == IMAGES[name]
    assert not [found for found in cuts if found.fault]
