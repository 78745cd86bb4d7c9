"""Commands to nodes, and how nodes should be and are set."""

import asyncio
import json
from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import Connection, RowMapping
from starlette.responses import Response

from eskin.identity import Identity
from eskin.runtime.http_server.problems import documented
from eskin.wire.envelope import sign
from eskin.wire.messages import Command, CommandName
from eskin.wire.messages.cbor_map import MOST_COUNT
from eskin.wire.messages.command import MOST_FORMULA, RANGES, check_arguments
from eskin.wire.timestamp import SECOND
from eskin.wire.topics import Stream, node_topic
from eskin_cloud.api.dependencies import Access, CloudState, Operator, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.app_state import AppState
from eskin_cloud.commands.issue import Order, issue
from eskin_cloud.schemas.base import NoQuery
from eskin_cloud.schemas.commands import CommandDocument, StateDocument
from eskin_cloud.store.read.lookup import UnknownChannelError, find_node
from eskin_cloud.store.write.audit_log import Action, AuditEntry, record
from eskin_cloud.store.write.commands import find_command, find_state
from eskin_cloud.store.write.write_cache import WriteCache

router = APIRouter(tags=["commands"])

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


def _number(setting: str) -> float | None:
    """A field of the request's body, with the range that the contract gives."""
    known = RANGES[setting]
    field: float | None = Field(default=None, ge=known.least, le=known.most, description=known.help)
    return field


class ArgumentsBody(BaseModel):
    """Arguments of a command; which belong together, the command's name decides."""

    model_config = _STRICT

    threshold: float | None = _number("threshold")
    gain: float | None = _number("gain")
    smoothing: float | None = _number("smoothing")
    rate: float | None = _number("rate")
    mode: Literal["samples", "peaks", "adaptive"] | None = Field(
        default=None, description="what the node sends"
    )
    adaptive: Literal["on", "off"] | None = Field(
        default=None, description="whether the node sets gain, trimmer and plates by itself"
    )
    taxel: str | None = Field(default=None, description="of this taxel; none means all")
    channel: str | None = Field(default=None, description="of this channel, with threshold")
    monitor: str | None = Field(default=None, description="name of the monitor")
    formula: str | None = Field(
        default=None,
        max_length=MOST_FORMULA,
        description="what it evaluates at each sample, with windows over the past; none removes it",
    )
    on: Literal["possible", "certain", "never"] | None = Field(
        default=None, description="the least verdict with which its output is on"
    )
    output: Literal["none", "stop", "out1", "out2", "out3"] | None = Field(
        default=None, description="what the node drives while it is"
    )
    nonce: str | None = Field(
        default=None, description="what the node signs once its gesture key is entered"
    )


class CommandBody(BaseModel):
    """A command."""

    model_config = _STRICT

    name: Literal["calibrate", "set", "reset", "monitor", "challenge"] = Field(
        description="what to do"
    )
    arguments: ArgumentsBody = ArgumentsBody()
    expires_s: float = Field(
        default=3600.0,
        ge=1,
        le=2_592_000,
        description="seconds after which it is not done any more",
    )


@router.post(
    "/nodes/{node}/commands",
    status_code=202,
    responses=REFUSALS_OF_PLACE | documented(408, 409, 413),
)
async def post_command(
    cloud: CloudState,
    access: Operator,
    node: str,
    body: CommandBody,
    response: Response,
    query: Annotated[NoQuery, Query()],
) -> CommandDocument:
    """Send a command to a node.

    The answer comes once the command is stored; read the command for its result.
    """
    del query
    name = CommandName(body.name)
    arguments = check_arguments(name, body.arguments.model_dump(exclude_none=True))
    order = Order(node, name, arguments, int(body.expires_s * SECOND))
    # Read for each command, so that a renewed certificate signs.
    own = await asyncio.to_thread(Identity.load, cloud.settings.gateways.identity)
    topic = node_topic(node, Stream.COMMANDS)

    def signed(command: Command) -> bytes:
        return sign(command.encode(), own=own, topic=topic)

    def work(connection: Connection, _: WriteCache) -> RowMapping:
        return issue(connection, order, sign=signed, now=cloud.clock())

    # The audit log is central, so an entry before the command states the intent.
    await _audit(cloud, access, Action.COMMAND_ASKED, node, f"{name} {json.dumps(arguments)}")
    row = await asyncio.wrap_future(cloud.store.write_node(node, work))
    detail = f"{row['id']}: {row['name']} {row['arguments']}"
    await _audit(cloud, access, Action.COMMAND, node, detail)
    cloud.notifier.wake()
    response.headers["Location"] = f"/api/v1/nodes/{node}/commands/{row['id']}"
    return CommandDocument.of(row, now=cloud.clock())


async def _audit(cloud: AppState, access: Access, action: Action, node: str, detail: str) -> None:
    entry = AuditEntry(access.actor.name, access.actor.address, action, node, detail)
    written = cloud.store.write(lambda connection: record(connection, entry, now=cloud.clock()))
    await asyncio.wrap_future(written)


@router.get(
    "/nodes/{node}/commands/{id}",
    responses=REFUSALS_OF_PLACE,
)
def get_command(
    cloud: CloudState,
    _: Reader,
    node: str,
    number: Annotated[int, Path(alias="id", ge=1, le=MOST_COUNT)],
    query: Annotated[NoQuery, Query()],
) -> CommandDocument:
    """Read a command and its result."""
    del query
    with cloud.store.read() as connection:
        find_node(connection, node)
        row = find_command(connection, node, number)
    if row is None:
        raise UnknownChannelError("id", f"{node} was never given a command {number}")
    return CommandDocument.of(row, now=cloud.clock())


@router.get("/nodes/{node}/state", responses=REFUSALS_OF_PLACE)
def get_state(
    cloud: CloudState, _: Reader, node: str, query: Annotated[NoQuery, Query()]
) -> StateDocument:
    """Read a node's desired and reported settings."""
    del query
    with cloud.store.read() as connection:
        find_node(connection, node)
        row = find_state(connection, node)
    return StateDocument.of(node, row)
