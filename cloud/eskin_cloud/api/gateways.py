"""Gateways: their health, spool and delay."""

from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import BaseModel

from eskin.wire.timestamp import SECOND
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS
from eskin_cloud.app_state import AppState
from eskin_cloud.schemas.base import (
    Instant,
    LagDocument,
    NoQuery,
    PageDocument,
    Row,
    lag,
    whole_minute,
)
from eskin_cloud.schemas.nodes import Health, judge_health
from eskin_cloud.store.write.gateways import list_gateways

router = APIRouter(tags=["nodes"])


class SpoolDocument(BaseModel):
    """What waited in a gateway's spool at its last report, and for how long (``oldest_ns``)."""

    reported: Instant
    messages: int
    bytes: int
    capacity_bytes: int
    oldest_ns: int | None
    dead_letters: int


class GatewayDocument(BaseModel):
    """A gateway; what it does not report is null."""

    id: str
    site: str
    health: Health
    first_heard: Instant
    last_heard: Instant
    nodes: int | None
    spool: SpoolDocument | None
    stored: int | None
    duplicate: int | None
    rejected: int | None
    latest: Instant | None
    lag: LagDocument | None


@router.get("/gateways", responses=REFUSALS)
def get_gateways(
    cloud: CloudState, access: Reader, query: Annotated[NoQuery, Query()]
) -> PageDocument[GatewayDocument]:
    """List the gateways, by name.

    Without the scope `biometric`, figures that count what is sealed are null, where any is.
    """
    del query
    with cloud.store.read() as connection:
        rows = list_gateways(connection)
        counted = not access.uncounted(connection)
    return PageDocument(items=[_gateway(cloud, row, counted=counted) for row in rows], next=None)


def _gateway(cloud: AppState, row: Row, *, counted: bool) -> GatewayDocument:
    given = dict(row) | {"id": row["gateway"], "health": _health(cloud, row)}
    if counted:
        return GatewayDocument.model_validate(given | {"spool": _spool(row), "lag": lag(row)})
    hidden = dict.fromkeys(("spool", "stored", "duplicate", "rejected", "latest", "lag"))
    heard = {"last_heard": whole_minute(row["last_heard"])}
    return GatewayDocument.model_validate(given | hidden | heard)


def _spool(row: Row) -> SpoolDocument | None:
    if row["reported"] is None:
        return None
    return SpoolDocument(
        reported=row["reported"],
        messages=row["messages"],
        bytes=row["used"],
        capacity_bytes=row["capacity"],
        oldest_ns=row["oldest"],
        dead_letters=row["dead_letters"],
    )


def _health(cloud: AppState, row: Row) -> Health:
    """As of a node; but a gateway that waits for an answer is silent as it should be."""
    now = cloud.clock()
    silence = (now - max(row["last_heard"], row["due"])) / SECOND
    ahead = (row["last_heard"] - now) / SECOND
    return judge_health(cloud.settings.nodes, silence, ahead=ahead)
