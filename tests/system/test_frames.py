"""Frames through Mosquitto, gateways and cloud as real processes; gateways die between layouts."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from eskin.wire.topics import Stream
from tests.support.files import ask
from tests.support.processes import wait_until
from tests.support.stacks import RealStack
from tests.unit.gateway.messages import status
from tests.unit.gateway.skins import LARGE, SkinNode
from tests.unit.gateway.wire_node import WireNode

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[RealStack]:
    with RealStack(tmp_path) as running:
        yield running


@pytest.fixture
def stack_of_two(tmp_path: Path) -> Iterator[RealStack]:
    with RealStack(tmp_path, gateways=2) as running:
        yield running


@contextmanager
def connected(stack: RealStack) -> Iterator[SkinNode]:
    """The node ``fingertip``, which has said its status."""
    own, site = stack.identities.node, stack.identities.site
    with WireNode(own, site, stack.broker.node_port) as node:
        node.say(Stream.STATUS, status(0))
        node.wait_for((1, 0))
        yield SkinNode(node, LARGE)


def stored(stack: RealStack) -> list[int]:
    """Sequences of the frames that the cloud has stored."""
    return [row[0] for row in ask(stack.store, "SELECT sequence FROM frames ORDER BY sequence")]


def require_described(stack: RealStack) -> None:
    """The cloud has each description of the node, and its bytes."""
    rows = ask(stack.store, "SELECT hash, data FROM descriptions WHERE node = 'fingertip'")
    assert dict(rows) == dict(zip(LARGE.hashes, LARGE.descriptions, strict=True))


def require_no_dead_letters(*databases: Path) -> None:
    for database in databases:
        assert ask(database, "SELECT reason FROM dead_letters") == []


@pytest.mark.nightly
def test_gateway_killed_between_frames_and_layouts_loses_nothing(stack: RealStack) -> None:
    with connected(stack) as skin:
        for number in range(1, 6):
            skin.node.say(Stream.FRAMES, LARGE.frame(number))
        wait_until(lambda: bool(skin.node.wanted), "the gateway asks for the layout")
        skin.node.say(Stream.LAYOUTS, LARGE.layout)
        for each in LARGE.patches[:2]:
            skin.node.say(Stream.LAYOUTS, each)
        skin.node.wait_for_broker()
        stack.gateway.kill()
        stack.start_gateway()
        skin.send(*range(1, 6))
        wait_until(lambda: stored(stack) == [1, 2, 3, 4, 5], "the cloud has all frames")
    require_described(stack)
    require_no_dead_letters(stack.spool, stack.store)


@pytest.mark.nightly
def test_spooled_frames_reach_a_later_cloud_with_their_layout(stack: RealStack) -> None:
    """The node has gone, and the gateway was killed: its spool has all."""
    stack.cloud.kill()
    with connected(stack) as skin:
        skin.describe()
        skin.send(*range(1, 6))
        skin.send(6, page=1)
    stack.gateway.kill()
    stack.start_gateway()
    stack.start_cloud()
    wait_until(lambda: stored(stack) == [1, 2, 3, 4, 5, 6], "the cloud has all frames")
    require_described(stack)
    require_no_dead_letters(stack.spool, stack.store)


@pytest.mark.nightly
def test_gateway_that_lacks_the_layouts_takes_over(stack_of_two: RealStack) -> None:
    stack = stack_of_two
    first, second = stack.gateways
    second.kill()
    with connected(stack) as skin:
        skin.describe()
        skin.send(*range(1, 4))
        assert skin.node.wanted == []
        wait_until(lambda: stored(stack) == [1, 2, 3], "the cloud has all frames")
        first.kill()
        starts = second.output().count("ready:")
        second.start()
        second.wait_for(
            lambda: second.output().count("ready:") > starts, "the second gateway is ready"
        )
        skin.send(*range(4, 8))
        assert set(skin.node.wanted) == set(LARGE.hashes), "it had none of them"
        wait_until(lambda: stored(stack) == [1, 2, 3, 4, 5, 6, 7], "the cloud has all frames")
    require_no_dead_letters(stack.folder / "spool-2.sqlite", stack.store)
