"""What each stack of containers is asked: rights, limits, and whether data flow and are whole."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import httpx

from eskin.wire.timestamp import parse_timestamp
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from tests.system.compose.stack import Stack

PSQL: Final = ("psql", "--no-psqlrc", "-At", "-h", "/run/database")
"""Query the database as the cloud does."""


def require_few_rights(stack: Stack, service: str) -> None:
    """Assert that a container has no right that it does not need."""
    status = dict(
        line.split(":\t", maxsplit=1)
        for line in stack.execute(service, "cat", "/proc/self/status").splitlines()
        if ":\t" in line
    )
    assert "0" not in status["Uid"].split()
    assert int(status["CapBnd"], 16) == 0
    assert status["NoNewPrivs"].strip() == "1"
    known = stack.inspect(service)
    assert known["Config"]["User"] not in {"", "root", "0"}
    assert known["HostConfig"]["ReadonlyRootfs"] is True
    assert known["HostConfig"]["RestartPolicy"]["Name"] == "unless-stopped"
    assert {mount["Type"] for mount in known["Mounts"]} == {"volume"}


def require_limits(stack: Stack, service: str) -> None:
    """Assert that a container takes so much memory and so many processes at most."""
    limits = stack.inspect(service)["HostConfig"]
    assert 0 < limits["Memory"] <= 1536 * 2**20
    assert limits["MemorySwap"] == limits["Memory"]
    assert 0 < limits["PidsLimit"] <= 512


def missing(stack: Stack) -> str:
    """Nodes and boots of which the store lacks messages between the first and the last one."""
    query = "select node, boot from sequences group by 1, 2 having count(*) > 1"
    return stack.execute("database", *PSQL, "-d", "eskin", "-c", query)


def wait_for_samples_after(
    stack: Stack, client: httpx.Client, instant: int, *, seconds: float = 90.0
) -> None:
    """Wait until a cloud has samples of each channel that are newer than an instant (UTC ns)."""

    def come() -> bool:
        try:
            channels = stack.channels(client)
        except httpx.HTTPError:
            return False  # the cloud, or a server of its store, has only just come back
        return all(parse_timestamp(channel["last"]) > instant for channel in channels.values())

    wait_until(come, "every channel has newer samples", seconds=seconds)
