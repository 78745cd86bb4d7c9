"""A key store for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from eskin.privacy import FileMasterKey, KeyStore

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def keystore(tmp_path: Path) -> KeyStore:
    """An empty key store."""
    return KeyStore(tmp_path / "keys", FileMasterKey(tmp_path / "master.key"), now=lambda: 7)
