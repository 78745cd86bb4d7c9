"""Fixtures that several rooms share."""

from __future__ import annotations

import pytest

from tests.identities import Identities


@pytest.fixture(scope="session")
def identities(tmp_path_factory: pytest.TempPathFactory) -> Identities:
    """A CA, a node, a site and a gateway."""
    return Identities(tmp_path_factory.mktemp("identities"))
