"""Commanding nodes in tests: as people do, and as gateways fetch."""

from __future__ import annotations

import asyncio
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final

import cbor2
from eskin_cloud.access import Scope, create_token

from eskin.identity import ChainVerifier, IdentityKind
from eskin.wire.envelope import Verifier
from eskin.wire.messages import Command, Outcome, Position, Result
from eskin.wire.topics import Stream, node_topic
from tests.support.processes import wait_until
from tests.unit.cloud.messages import NODE, START

if TYPE_CHECKING:
    import httpx

    from eskin.wire.messages.command import State
    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

SOON_S: Final = 30.0
"""Half of the time for which `waiting_gateway` waits, unless it is woken."""


def result(
    sequence: int,
    command: int,
    *,
    boot: int = 1,
    reason: str | None = None,
    state: State | None = None,
) -> Result:
    """A node's answer; refused where there is a reason."""
    outcome = Outcome.DONE if reason is None else Outcome.REFUSED
    place = Position(boot, sequence)
    return Result(place, (START, START + 9), command, outcome, reason, state or {})


async def order(
    stand: Stand, body: Any, *, node: str = NODE, token: str | None = None, **options: Any
) -> httpx.Response:
    """Ask something of a node."""
    if token is None:
        token = create_token(
            stand.cloud.store,
            scopes=[Scope.READ, Scope.OPERATE],
            name="operator",
            lifetime=timedelta(hours=1),
        )
    async with stand.client(token=token) as client:
        return await client.post(f"/api/v1/nodes/{node}/commands", json=body, **options)


async def fetch(
    stand: Stand,
    held: Any = (),
    *,
    wait: Any = 0.0,
    body: bytes | None = None,
    published: int | None = None,
) -> httpx.Response:
    """Ask for commands as a gateway does."""
    if body is None:
        body = cbor2.dumps({"held": list(held), "wait_s": wait, "published": published})
    async with stand.ingest_client() as client:
        return await client.post("/api/v1/deliveries", content=body)


async def waiting_gateway(stand: Stand, *held: Any) -> asyncio.Task[httpx.Response]:
    """A gateway that asked for commands, and waits for one."""
    asked = asyncio.create_task(fetch(stand, held, wait=2 * SOON_S))
    await asyncio.to_thread(wait_until, lambda: stand.cloud.notifier.waiting == 1, "it waits")
    return asked


def opened(identities: Identities, signed: bytes, node: str = NODE) -> Command:
    """A command, as the node checks it."""
    verifier = Verifier(
        ChainVerifier(*identities.authority.roots), kind=IdentityKind.SERVER, name="server.cloud"
    )
    return Command.decode(verifier.verify(signed, topic=node_topic(node, Stream.COMMANDS)))
