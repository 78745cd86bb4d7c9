"""A key store for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from eskin.privacy import FileMaster, Vault

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def vault(tmp_path: Path) -> Vault:
    """An empty key store."""
    return Vault(tmp_path / "keys", FileMaster(tmp_path / "master.key"), now=lambda: 7)
