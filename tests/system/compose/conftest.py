"""One engine and one stack for all tests here."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.system.compose.engine import container_engine
from tests.system.compose.progress import teller
from tests.system.compose.stack import Stack, brought_up

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@pytest.fixture(scope="session")
def say(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Shows at once how far the tests are, with the seconds since their start."""
    return teller(request.config)


@pytest.fixture(scope="session")
def stack(tmp_path_factory: pytest.TempPathFactory, say: Callable[[str], None]) -> Iterator[Stack]:
    """Everything, built and healthy."""
    say("starting a container engine and making the base image ...")
    with container_engine() as environment:
        stack = Stack(environment, tmp_path_factory.mktemp("compose"))
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
