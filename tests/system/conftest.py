"""Stores for several clouds: on a PostgreSQL server, and on one Citus for all tests here.

Citus is built from a source tree that the caller names.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import pytest

from tests.support.citus import NO_SOURCE, CitusCluster, citus_programs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sqlalchemy import URL

    from tests.support.postgresql import Cluster


@pytest.fixture(scope="session")
def programs() -> Iterator[Path]:
    """The folder of the programs of a PostgreSQL with Citus."""
    with citus_programs() as folder:
        if folder is None:
            pytest.skip(f"{NO_SOURCE} (make test-cluster)")
        yield folder


@pytest.fixture(scope="session")
def servers(programs: Path) -> Iterator[CitusCluster]:
    """A coordinator and two workers; tests stop none for good and add none."""
    with CitusCluster(programs) as running:
        yield running


@pytest.fixture(
    scope="module", params=["postgresql", pytest.param("citus", marks=pytest.mark.cluster)]
)
def make_place(request: pytest.FixtureRequest) -> Callable[[], URL]:
    """Makes empty stores: on a PostgreSQL server, and distributed ones on Citus."""
    if request.param == "citus":
        servers: CitusCluster = request.getfixturevalue("servers")
        return servers.fresh
    cluster: Cluster = request.getfixturevalue("cluster")
    return partial(cluster.fresh, empty=True)
