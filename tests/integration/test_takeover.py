"""Two gateways share a site; one dies or hangs, and the other takes over."""

from __future__ import annotations

import logging
import signal
import time
from typing import TYPE_CHECKING

import pytest

from eskin.identity.identity import CHAIN_FILE
from eskin.moment import SECOND
from tests.files import ask, write_settings
from tests.processes import ESKIN, Running, wait_until
from tests.stacks import RealStack

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

log = logging.getLogger(__name__)

LIMIT_S = 5.0
_KEEPALIVE_S = 1
_RESEND_S = 1.0
_WATCHED_S = 3


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[RealStack]:
    with RealStack(tmp_path, gateways=2, keepalive_s=_KEEPALIVE_S) as running:
        yield running


def sensor_node(stack: RealStack) -> Running:
    config = write_settings(stack.folder / "node.toml", {
        "node": {"name": "fingertip", "profile": "fingertip"},
        "sampling": {"block_samples": 50},
        "broker": {"host": "127.0.0.1", "port": stack.broker.node_port,
                   "resend_s": _RESEND_S, "drain_s": 30.0},
        "identity": {"directory": stack.identities.node.directory,
                     "site": stack.identities.site.directory / CHAIN_FILE},
        "flash": {"path": stack.folder / "flash.sqlite"},
        "truth": {"path": stack.folder / "truth.sqlite"},
    })  # fmt: skip
    return Running([ESKIN, "node", "--config", str(config)], log=stack.folder / "node.log")


def taken(stack: RealStack, number: int) -> int:
    """How many messages a gateway ever took."""
    spool = stack.spool if number == 1 else stack.folder / f"spool-{number}.sqlite"
    rows = ask(spool, "SELECT seq FROM sqlite_sequence WHERE name = 'messages'")
    return int(rows[0][0]) if rows else 0


def lateness_s(stack: RealStack, begin: int, end: int) -> float:
    """The longest time from a block's last sample until it was stored, of those of a while."""
    query = f"SELECT max(received - t_end) FROM blocks WHERE t_end BETWEEN {begin} AND {end}"  # noqa: S608
    return int(ask(stack.store, query)[0][0]) / SECOND


def delay_s(stack: RealStack, end: Callable[[], None]) -> float:
    """How much later blocks are stored than just before, while the other gateway takes over."""
    moment = time.time_ns()
    end()
    horizon = moment + _WATCHED_S * SECOND
    later = f"SELECT count(*) FROM blocks WHERE t_end > {horizon}"  # noqa: S608
    wait_until(lambda: ask(stack.store, later)[0][0] > 5, "blocks are stored again", seconds=40)
    usual = lateness_s(stack, moment - 3 * SECOND, moment - SECOND)
    return lateness_s(stack, moment - SECOND, horizon) - usual


def both_share(stack: RealStack) -> None:
    """Wait until each gateway has taken some more."""
    before = [taken(stack, number) for number in (1, 2)]
    wait_until(
        lambda: all(taken(stack, n) > before[n - 1] + 3 for n in (1, 2)),
        "both share the load",
        seconds=120,
    )


@pytest.mark.timeout(300)
def test_other_gateway_takes_over_with_nothing_lost_or_doubled(stack: RealStack) -> None:
    other = stack.gateways[1]
    with sensor_node(stack) as node:
        both_share(stack)
        stopped = delay_s(stack, lambda: other.signal(signal.SIGSTOP))
        other.signal(signal.SIGCONT)
        both_share(stack)
        killed = delay_s(stack, other.kill)
        assert node.stop(seconds=40) == 0
        assert "waiting=0" in node.output(), node.output()
        # What it took and had not forwarded is durable in its spool, and comes when it does.
        other.start()
        wait_until(lambda: not spooled(stack), "what a gateway took is stored", seconds=60)
    log.info("blocks came later by %.2f s (stopped) and %.2f s (killed)", stopped, killed)
    assert stopped < LIMIT_S
    assert killed < LIMIT_S
    require_each_once(stack)


def spooled(stack: RealStack) -> int:
    """Messages that a gateway holds."""
    spools = (stack.spool, stack.folder / "spool-2.sqlite")
    return sum(int(ask(spool, "SELECT count(*) FROM messages")[0][0]) for spool in spools)


def require_each_once(stack: RealStack) -> None:
    """No number is missing, and no block is there twice."""
    assert [(first, ranges) for first, ranges in ask(
        stack.store, "SELECT min(first), count(*) FROM sequences GROUP BY node, boot"
    )] == [(0, 1)]  # fmt: skip
    query = "SELECT count(*), count(DISTINCT sequence) FROM blocks"
    ((blocks, different),) = ask(stack.store, query)
    assert blocks == different > 0
