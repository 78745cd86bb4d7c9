"""Fixtures that several rooms share, and which tests may run side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from eskin.identity import IdentityKind
from tests.identities import Identities
from tests.postgresql import Cluster

if TYPE_CHECKING:
    from collections.abc import Iterator

HERE = Path(__file__).parent
CALCULATING = ("eskin", "sensor_node")
"""Rooms whose tests only calculate: beside them, brokers, browsers and demos have their peace."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep all tests that start real parts together, one after the other on one worker."""
    for item in items:
        room = item.path.relative_to(HERE).parts[0]
        group = str(item.path.relative_to(HERE)) if room in CALCULATING else "parts"
        item.add_marker(pytest.mark.xdist_group(group))


@pytest.fixture(scope="session")
def identities(tmp_path_factory: pytest.TempPathFactory) -> Identities:
    """A CA, a node, a site and a gateway."""
    return Identities(tmp_path_factory.mktemp("identities"))


@pytest.fixture(scope="session")
def cluster(identities: Identities) -> Iterator[Cluster]:
    """A PostgreSQL server, started when the first test asks for it."""
    with Cluster(identities.make(IdentityKind.SERVER, "server.database")) as running:
        yield running
