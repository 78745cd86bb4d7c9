"""What all tests of the CA's service share."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clients wait as long as a slow machine takes for a certificate."""
    monkeypatch.setattr("eskin_ca.http_client._TIMEOUT_S", 120.0)
