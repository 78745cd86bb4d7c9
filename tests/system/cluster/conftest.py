"""One Citus for all tests here, built from a source tree that the caller names."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.support.citus import NO_SOURCE, SOURCE, CitusCluster, build

if TYPE_CHECKING:
    from collections.abc import Iterator

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
