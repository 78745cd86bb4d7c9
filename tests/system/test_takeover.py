"""Two gateways share a site; one is killed, and the other takes over."""

from __future__ import annotations

import logging
import signal
import time
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from eskin.wire.messages.cbor_map import load
from eskin.wire.messages.header import read_position
from eskin.wire.timestamp import SECOND
from tests.support.files import ask
from tests.support.processes import Running, wait_until
from tests.support.stacks import RealStack

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.nightly

log = logging.getLogger(__name__)

LIMIT_S = 5.0
_KEEPALIVE_S = 60
"""A takeover that needed its end would fail by far."""


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[RealStack]:
    with RealStack(tmp_path, gateways=2, keepalive_s=_KEEPALIVE_S) as running:
        yield running


def spools(stack: RealStack) -> list[Path]:
    return [stack.spool, stack.folder / "spool-2.sqlite"]


def forwarded(spool: Path) -> int:
    """How many messages a gateway has ever taken and brought to the cloud."""
    rows = ask(spool, "SELECT seq FROM sqlite_sequence WHERE name = 'messages'")
    return (int(rows[0][0]) if rows else 0) - len(held(spool))


def both_share(stack: RealStack) -> None:
    enough = [forwarded(spool) + 20 for spool in spools(stack)]
    wait_until(
        lambda: all(
            forwarded(spool) > least for spool, least in zip(spools(stack), enough, strict=True)
        ),
        "both share the load",
    )


def missing(stack: RealStack) -> set[int]:
    """Numbers that the cloud has not stored, though it has later ones."""
    rows = sorted(ask(stack.store, "SELECT first, last FROM sequences"))
    pairs = pairwise([(0, -1), *rows])
    return {number for (_, last), (first, _) in pairs for number in range(last + 1, first)}


def held(spool: Path) -> set[int]:
    """Numbers that a gateway has taken and not forwarded."""
    bodies = ask(spool, "SELECT body FROM messages")
    return {read_position(load(body)).sequence for (body,) in bodies}


@dataclass(frozen=True)
class Death:
    """A gateway's.

    Attributes:
        ended: When it was killed, UTC ns.
        stuck: Numbers of what was in it, unacknowledged.
    """

    ended: int
    stuck: set[int]

    def delay_s(self, stack: RealStack) -> float:
        """How long after it the last of what was stuck came, by the store's own time."""
        rows = ask(stack.store, "SELECT sequence, received FROM frames")
        last: int = max(received for number, received in rows if number in self.stuck)
        return (last - self.ended) / SECOND

    def usual_s(self, stack: RealStack) -> float:
        """How long at most what was measured after it, and went the other way, was on its way."""
        query = "SELECT max(received - t_end) FROM frames WHERE t_end BETWEEN {} AND {}"
        until = self.ended + round(LIMIT_S * SECOND)
        ((late,),) = ask(stack.store, query.format(self.ended, until))
        return (late or 0) / SECOND


def kill(stack: RealStack, gateway: Running, spool: Path) -> Death:
    """Kill a gateway at a bad instant, and wait until the other one has taken over."""
    gateway.signal(signal.SIGSTOP)  # and the broker goes on giving it its share
    wait_until(lambda: len(missing(stack) - held(spool)) > 10, "some is stuck in it")
    gateway.kill()
    ended = time.time_ns()
    kept = held(spool)
    stuck = missing(stack) - kept
    wait_until(lambda: missing(stack) <= kept, "the other gateway takes over")
    return Death(ended, stuck)


@pytest.mark.timeout(600)
def test_other_gateway_takes_over_with_nothing_lost_or_doubled(stack: RealStack) -> None:
    with stack.sensor_node() as node:
        both_share(stack)
        death = kill(stack, stack.gateway, stack.spool)
        assert node.stop() == 0
        assert "waiting=0" in node.output(), node.output()
        stack.gateway.start()
        wait_until(lambda: not held(stack.spool), "what the victim held is stored")
    delay, usual = death.delay_s(stack), death.usual_s(stack)
    log.info("longest delay: %.2f s; of what did not meet the victim: %.2f s", delay, usual)
    assert delay - usual < LIMIT_S, "what the machine takes is no fault"
    require_each_once(stack.store)


def require_each_once(store: Path) -> None:
    """No number is missing, and no frame is there twice."""
    query = "SELECT min(first), count(*) FROM sequences GROUP BY node, boot"
    assert ask(store, query) == [(0, 1)]
    ((frames, different),) = ask(store, "SELECT count(*), count(DISTINCT sequence) FROM frames")
    assert frames == different > 0
