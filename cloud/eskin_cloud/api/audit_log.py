"""The audit log: who did what."""

from typing import Annotated

from fastapi import APIRouter, Query

from eskin_cloud.api.dependencies import Administrator, CloudState
from eskin_cloud.api.nodes import ListQuery
from eskin_cloud.api.problems import REFUSALS
from eskin_cloud.schemas.access import AuditEntryDocument
from eskin_cloud.schemas.base import PageDocument
from eskin_cloud.store.write.audit_log import list_audit_entries

router = APIRouter(tags=["access"])

_PAGE = 1000


@router.get("/audit-log", responses=REFUSALS)
def get_audit_log(
    cloud: CloudState, _: Administrator, query: Annotated[ListQuery, Query()]
) -> PageDocument[AuditEntryDocument]:
    """List the audit log, the latest entry first.

    An entry's ``digest`` covers it and all entries before it.
    """
    ids = cloud.feed.ids
    before = None if query.cursor is None else ids.read(query.cursor, 1)[0]
    with cloud.store.read() as connection:
        rows, following = list_audit_entries(connection, before=before, limit=_PAGE)
    cursor = None if following is None else ids.write(following)
    items = [AuditEntryDocument.model_validate(row) for row in rows]
    return PageDocument(items=items, next=cursor)
