"""One engine and one stack for all tests here."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest

from tests.support.processes import wait_until
from tests.system.compose.engine import container_engine
from tests.system.compose.stack import NODES, Stack, items

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@pytest.fixture(scope="session")
def say(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Tells at once how far the tests are, with the seconds since their start."""
    terminal = request.config.get_terminal_writer()
    capture = request.config.pluginmanager.getplugin("capturemanager")
    start = time.monotonic()

    def show(text: str) -> None:
        with capture.global_and_fixture_disabled():
            terminal.line(f"[{time.monotonic() - start:4.0f} s] {text}", flush=True)

    return show


@pytest.fixture(scope="session")
def stack(tmp_path_factory: pytest.TempPathFactory, say: Callable[[str], None]) -> Iterator[Stack]:
    """Everything, built and healthy."""
    say("starting a container engine and making the base image ...")
    with container_engine() as environment:
        stack = Stack(environment, tmp_path_factory.mktemp("compose"))
        healthy = False
        try:
            say("building the images ...")
            stack.build()
            say("starting the stack ...")
            stack.up()
            say("the stack is healthy")
            wait_until(lambda: _all_are_known(stack), "each node has reported", seconds=300)
            healthy = True
            yield stack
        finally:
            if not healthy:
                say(stack.logs())
            stack.compose("down", "--volumes", "--timeout", "10", seconds=120)
            say("the stack is down")


def _all_are_known(stack: Stack) -> bool:
    """Whether the cloud has heard of each node: on a fresh machine, kernels are compiled first."""
    with stack.client() as client:
        known = {node["id"] for node in items(client, "/api/v1/nodes")}
    return known == set(NODES)


@pytest.fixture(autouse=True)
def _logs_of_failed_test(
    request: pytest.FixtureRequest, stack: Stack, say: Callable[[str], None]
) -> Iterator[None]:
    failed = request.session.testsfailed
    yield
    if request.session.testsfailed > failed:
        say(stack.logs())
