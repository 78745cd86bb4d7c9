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
    from collections.abc import Iterator
    from pathlib import Path

log = logging.getLogger(__name__)

LIMIT_S = 5.0
_KEEPALIVE_S = 1
_RESEND_S = 1.0


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


def delay_s(stack: RealStack, since: int) -> float:
    """The longest time from a block's last sample until it was stored, from a moment on."""
    query = f"SELECT max(received - t_end) FROM blocks WHERE t_end > {since - SECOND}"  # noqa: S608
    return int(ask(stack.store, query)[0][0]) / SECOND


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_other_gateway_takes_over_with_nothing_lost_or_doubled(
    stack: RealStack, end: signal.Signals
) -> None:
    gone = stack.gateways[1]
    with sensor_node(stack) as node:
        wait_until(lambda: taken(stack, 1) > 3 and taken(stack, 2) > 3, "both share the load")
        moment = time.time_ns()
        gone.signal(end)
        horizon = moment + int(LIMIT_S * SECOND)
        later = f"SELECT count(*) FROM blocks WHERE t_end > {horizon}"  # noqa: S608
        wait_until(lambda: ask(stack.store, later)[0][0] > 5, "blocks are stored again", seconds=30)
        assert node.stop(seconds=40) == 0
        assert "waiting=0" in node.output(), node.output()
        found = delay_s(stack, moment)
        # What it took and had not forwarded is durable in its spool, and comes when it does.
        if end == signal.SIGKILL:
            gone.kill()
            gone.start()
        else:
            gone.signal(signal.SIGCONT)
        wait_until(lambda: not spooled(stack), "what a gateway took is stored", seconds=30)
    log.info("%s: stored after %.2f s at most", end.name, found)
    assert found < LIMIT_S
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
