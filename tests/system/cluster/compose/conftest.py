"""The stack of docker-compose.cluster.yml on an engine, with Citus from a source tree."""

from __future__ import annotations

import os
import shutil
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING

import pytest

from tests.support.citus import NO_SOURCE, SOURCE
from tests.system.compose.engine import container_engine
from tests.system.compose.progress import teller
from tests.system.compose.stack import FILES, REPOSITORY, SERVICES, Stack, brought_up

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

CLUSTER_FILE = REPOSITORY / "docker-compose.cluster.yml"
CLOUDS = {"cloud": "ESKIN_PORT", "cloud2": "ESKIN_PORT2", "cloud3": "ESKIN_PORT3"}
"""Each with the variable that names its port on this machine."""
WORKERS = ("database_worker1", "database_worker2")
ADDED = (*WORKERS, "cloud2", "cloud3", "gateway2")
"""Services that are not in docker-compose.yml, and go on running."""


@pytest.fixture(scope="session")
def say(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Shows at once how far the tests are, with the seconds since their start."""
    return teller(request.config)


@pytest.fixture(scope="session")
def stack(tmp_path_factory: pytest.TempPathFactory, say: Callable[[str], None]) -> Iterator[Stack]:
    """Three clouds, two gateways, three nodes and a cluster, built and healthy."""
    source = os.environ.get(SOURCE)
    if not source:
        pytest.skip(NO_SOURCE)
    say("starting a container engine and making the base image ...")
    with within_repository(Path(source).resolve()) as folder, container_engine() as environment:
        stack = Stack(
            {**environment, "CITUS_SOURCE": folder},
            tmp_path_factory.mktemp("compose"),
            project="eskin-cluster-test",
            files=(*FILES, CLUSTER_FILE, Path(__file__).with_name("patience.yml")),
            clouds=CLOUDS,
            services=(*SERVICES, *ADDED),
        )
        with brought_up(stack, say):
            yield stack


@pytest.fixture(autouse=True)
def _logs_of_failed_test(
    request: pytest.FixtureRequest, stack: Stack, say: Callable[[str], None]
) -> Iterator[None]:
    failed = request.session.testsfailed
    yield
    if request.session.testsfailed > failed:
        say(stack.logs())


@contextmanager
def within_repository(source: Path) -> Iterator[str]:
    """A copy of a source tree where an image's build reaches it; gives its path from there."""
    build = REPOSITORY / "build"
    build.mkdir(exist_ok=True)
    folder = Path(mkdtemp(prefix="citus-", dir=build))
    try:
        shutil.copytree(
            source,
            folder,
            symlinks=True,
            ignore=shutil.ignore_patterns(".git"),
            dirs_exist_ok=True,
        )
        yield str(folder.relative_to(REPOSITORY))
    finally:
        shutil.rmtree(folder)
