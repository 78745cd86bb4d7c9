"""Gateways: whether they are heard, what waits in them, and how late they bring it."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel
from starlette.responses import Response

from eskin.wire.timestamp import SECOND, format_timestamp
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS
from eskin_cloud.api.responses import as_json
from eskin_cloud.api.sealed_counts import uncounted
from eskin_cloud.app_state import AppState
from eskin_cloud.schemas.documents import LagDocument, Moment, NoQuery, PageDocument
from eskin_cloud.schemas.shapes import Json, Row, health_shape, lag_shape, page, whole_minute
from eskin_cloud.store.write.gateways import list_gateways

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
    site: str
    health: Literal["online", "late", "offline"]
    first_heard: Moment
    last_heard: Moment
    nodes: int | None
    spool: SpoolDocument | None
    stored: int | None
    duplicate: int | None
    rejected: int | None
    latest: Moment | None
    lag: LagDocument | None


@router.get("/gateways", response_model=PageDocument[GatewayDocument], responses=REFUSALS)
def get_gateways(cloud: CloudState, access: Reader, query: Annotated[NoQuery, Query()]) -> Response:
    """List the gateways, by name.

    Without the scope `biometric`, figures that count what is sealed are null, where any is.
    """
    del query
    with cloud.store.read() as connection:
        rows = list_gateways(connection)
        counted = not uncounted(connection, access)
    items = [_shape(cloud, row) for row in rows]
    if not counted:
        items = [_coarse(item, row) for item, row in zip(items, rows, strict=True)]
    return as_json(page(items, None))


def _coarse(item: Json, row: Row) -> Json:
    counts = dict.fromkeys(("spool", "stored", "duplicate", "rejected", "latest", "lag"))
    return item | counts | {"last_heard": format_timestamp(whole_minute(row["last_heard"]))}


def _shape(cloud: AppState, row: Row) -> Json:
    spool = None
    if row["told"] is not None:
        spool = {
            "told": format_timestamp(row["told"]),
            "messages": row["messages"],
            "bytes": row["used"],
            "capacity_bytes": row["capacity"],
            "oldest_ns": row["oldest"],
            "dead_letters": row["dead_letters"],
        }
    return {
        "id": row["gateway"],
        "site": row["site"],
        "health": _health(cloud, row),
        "first_heard": format_timestamp(row["first_heard"]),
        "last_heard": format_timestamp(row["last_heard"]),
        "nodes": row["nodes"],
        "spool": spool,
        "stored": row["stored"],
        "duplicate": row["duplicate"],
        "rejected": row["rejected"],
        "latest": None if row["latest"] is None else format_timestamp(row["latest"]),
        "lag": lag_shape(row),
    }


def _health(cloud: AppState, row: Row) -> str:
    """As nodes are judged; but while it waits for an answer, its silence is as it should be."""
    now = cloud.clock()
    silence = (now - max(row["last_heard"], row["due"])) / SECOND
    ahead = (row["last_heard"] - now) / SECOND
    return health_shape(cloud.settings.nodes, silence, ahead=ahead)
