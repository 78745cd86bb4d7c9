"""Gateways: whether they are heard, what waits in them, and how late they bring it."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel
from starlette.responses import Response

from cloud.dependencies import CloudState, Reader
from cloud.routes.answers import as_json
from cloud.routes.documents import (
    REFUSALS,
    LagDocument,
    Moment,
    NoQuery,
    PageDocument,
)
from cloud.shapes import Json, Row, health_shape, lag_shape, page
from cloud.state import Cloud
from cloud.store.gateways import list_gateways
from eskin.moment import SECOND, format_moment

router = APIRouter(tags=["nodes"])


class SpoolDocument(BaseModel):
    """What waited in a gateway's spool when it told so; ``oldest_ns`` is for how long already."""

    told: Moment
    messages: int
    bytes: int
    capacity_bytes: int
    oldest_ns: int | None
    dead_letters: int


class GatewayDocument(BaseModel):
    """A gateway; what it does not tell is null."""

    id: str
    health: Literal["online", "late", "offline"]
    first_heard: Moment
    last_heard: Moment
    nodes: int | None
    spool: SpoolDocument | None
    stored: int
    duplicate: int
    rejected: int
    latest: Moment | None
    lag: LagDocument | None


@router.get("/gateways", response_model=PageDocument[GatewayDocument], responses=REFUSALS)
def get_gateways(cloud: CloudState, _: Reader, query: Annotated[NoQuery, Query()]) -> Response:
    """All gateways that ever proved who they are, by name."""
    del query
    with cloud.store.read() as connection:
        rows = list_gateways(connection)
    return as_json(page([_shape(cloud, row) for row in rows], None))


def _shape(cloud: Cloud, row: Row) -> Json:
    spool = None
    if row["told"] is not None:
        spool = {
            "told": format_moment(row["told"]),
            "messages": row["messages"],
            "bytes": row["used"],
            "capacity_bytes": row["capacity"],
            "oldest_ns": row["oldest"],
            "dead_letters": row["dead_letters"],
        }
    return {
        "id": row["gateway"],
        "health": _health(cloud, row),
        "first_heard": format_moment(row["first_heard"]),
        "last_heard": format_moment(row["last_heard"]),
        "nodes": row["nodes"],
        "spool": spool,
        "stored": row["stored"],
        "duplicate": row["duplicate"],
        "rejected": row["rejected"],
        "latest": None if row["latest"] is None else format_moment(row["latest"]),
        "lag": lag_shape(row),
    }


def _health(cloud: Cloud, row: Row) -> str:
    """As nodes are judged; but while it waits for an answer, its silence is as it should be."""
    now = cloud.clock()
    silence = (now - max(row["last_heard"], row["due"])) / SECOND
    ahead = (row["last_heard"] - now) / SECOND
    return health_shape(cloud.settings.nodes, silence, ahead=ahead)
