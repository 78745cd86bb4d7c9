"""The audit log: who did what."""

from typing import Annotated

from fastapi import APIRouter, Query
from starlette.responses import Response

from eskin_cloud.api.dependencies import Administrator, CloudState
from eskin_cloud.api.nodes import ListQuery
from eskin_cloud.api.problems import REFUSALS
from eskin_cloud.api.responses import as_json
from eskin_cloud.query.cursors import read_numbers, write_cursor
from eskin_cloud.schemas.documents import DeedDocument, PageDocument
from eskin_cloud.schemas.shapes import audit_entry_shape, page
from eskin_cloud.store.write.audit_log import list_audit_entries

router = APIRouter(tags=["access"])

_PAGE = 1000


@router.get("/audit-log", response_model=PageDocument[DeedDocument], responses=REFUSALS)
def get_audit_log(
    cloud: CloudState, _: Administrator, query: Annotated[ListQuery, Query()]
) -> Response:
    """List the audit log, the latest entry first.

    An entry's ``digest`` covers it and all entries before it.
    """
    before = None if query.cursor is None else read_numbers(query.cursor, 1)[0]
    with cloud.store.read() as connection:
        rows, following = list_audit_entries(connection, before=before, limit=_PAGE)
    cursor = None if following is None else write_cursor(following)
    return as_json(page([audit_entry_shape(row) for row in rows], cursor))
