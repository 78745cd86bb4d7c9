"""Stores for several clouds: on a PostgreSQL server, and on one Citus for all tests here.

Citus is built from a source tree that the caller names.
"""

from __future__ import annotations

import os
import shutil
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.support.citus import NO_SOURCE, SOURCE, CitusCluster, build

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sqlalchemy import URL

    from tests.support.postgresql import Cluster

PROGRAMS = "ESKIN_CITUS_PROGRAMS"
"""Folder of the programs of a PostgreSQL with Citus, where it was built before."""


@pytest.fixture(scope="session")
def programs() -> Iterator[Path]:
    """The folder of the programs of a PostgreSQL with Citus."""
    built, source = os.environ.get(PROGRAMS), os.environ.get(SOURCE)
    if built:
        yield Path(built)
        return
    if not source:
        pytest.skip(NO_SOURCE)
    copy, folder = build(Path(source).resolve())
    yield folder
    shutil.rmtree(copy)


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
