"""The audit log: who did what."""

from typing import Annotated

from fastapi import APIRouter, Query
from starlette.responses import Response

from cloud.dependencies import Administrator, CloudState
from cloud.query.cursors import read_numbers, write_cursor
from cloud.routes.answers import as_json
from cloud.routes.documents import REFUSALS, DeedDocument, PageDocument
from cloud.routes.nodes import ListQuery
from cloud.shapes import deed_shape, page
from cloud.store.audit_log import list_deeds

router = APIRouter(tags=["access"])

_PAGE = 1000


@router.get("/audit-log", response_model=PageDocument[DeedDocument], responses=REFUSALS)
def get_audit_log(
    cloud: CloudState, _: Administrator, query: Annotated[ListQuery, Query()]
) -> Response:
    """Who did what, the latest first; ``digest`` seals a deed and all before it."""
    before = None if query.cursor is None else read_numbers(query.cursor, 1)[0]
    with cloud.store.read() as connection:
        rows, following = list_deeds(connection, before=before, limit=_PAGE)
    cursor = None if following is None else write_cursor(following)
    return as_json(page([deed_shape(row) for row in rows], cursor))
