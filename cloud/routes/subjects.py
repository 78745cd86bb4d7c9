"""Subjects: of whom there is what, by pseudonym, and all that is held of one."""

import asyncio
from collections.abc import Iterator
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query
from sqlalchemy import func, select
from starlette.responses import Response, StreamingResponse

from cloud.dependencies import Access, Administrator, BiometricReader, CloudState
from cloud.privacy.erasures import look
from cloud.privacy.keyholder import Reader
from cloud.problems import ProblemError
from cloud.query.errors import UnknownPlaceError
from cloud.routes.answers import as_json
from cloud.routes.documents import (
    REFUSALS,
    REFUSALS_OF_PLACE,
    NoQuery,
    PageDocument,
    SubjectDocument,
)
from cloud.shapes import block_shape, dump, event_shape, page
from cloud.state import Cloud
from cloud.store.audit_log import Action, Deed, record
from cloud.store.events import peak_row
from cloud.store.sealed import erased_subjects, veiled, wearers
from eskin.errors import NoKeyError
from eskin.messages import Peak
from eskin.moment import format_moment
from eskin.privacy import Veiled

router = APIRouter(tags=["subjects"])

_LINES: Final = "application/x-ndjson"


@router.get("/subjects", response_model=PageDocument[SubjectDocument], responses=REFUSALS)
def get_subjects(
    cloud: CloudState, _: Administrator, query: Annotated[NoQuery, Query()]
) -> Response:
    """All pseudonyms that gateways told of, the nodes they wore, and what is held of them."""
    del query
    counted = select(veiled.c.subject, func.count()).group_by(veiled.c.subject)
    with cloud.store.read() as connection:
        held = {row[0]: int(row[1]) for row in connection.execute(counted)}
        gone = {row[0]: row[1] for row in connection.execute(select(erased_subjects))}
        worn: dict[str, list[str]] = {}
        for row in connection.execute(select(wearers).order_by(wearers.c.node)):
            worn.setdefault(row.subject, []).append(row.node)
    items = [
        {
            "id": subject,
            "nodes": worn.get(subject, []),
            "messages": held.get(subject, 0),
            "erased": None if subject not in gone else format_moment(gone[subject]),
        }
        for subject in sorted(held.keys() | gone.keys() | worn.keys())
    ]
    return as_json(page(items, None))


@router.get(
    "/subjects/{subject}/export",
    response_class=StreamingResponse,
    responses={200: {"content": {_LINES: {}}}, **REFUSALS_OF_PLACE},
)
async def get_export(
    cloud: CloudState, access: BiometricReader, subject: str, query: Annotated[NoQuery, Query()]
) -> Response:
    """All that is held of a subject: JSON lines, each a block or a peak, in order of storing."""
    del query
    reader = Reader(cloud.keyholder.require(access.holder.scopes), access.opened)
    await asyncio.to_thread(_require_key, cloud, subject)
    deed = Deed(access.doer.name, access.doer.address, Action.SUBJECT_EXPORTED, subject)
    written = cloud.store.write(lambda c: record(c, deed, now=cloud.clock()))
    await asyncio.wrap_future(written)
    return StreamingResponse(stream_lines(cloud, access, reader, subject), media_type=_LINES)


def _require_key(cloud: Cloud, subject: str) -> None:
    if cloud.keyholder.vault is not None:
        look(cloud)
        try:
            cloud.keyholder.vault.find(subject)
        except NoKeyError as error:
            raise UnknownPlaceError("subject", str(error)[:200]) from error


def stream_lines(cloud: Cloud, access: Access, reader: Reader, subject: str) -> Iterator[bytes]:
    """A subject's lines, for as long as the reader may read."""
    last = -1
    while True:
        query = select(veiled).where(veiled.c.subject == subject, veiled.c.cursor > last)
        with cloud.store.read() as connection:
            cloud.keyholder.heed(connection)
            rows = connection.execute(query.order_by(veiled.c.cursor).limit(200)).mappings().all()
        if not rows:
            return
        for row in rows:
            if not access.lasts():
                raise ProblemError(401, "the token was revoked while it was used")
            yield dump(_line(cloud, reader, dict(row))) + b"\n"
        last = rows[-1]["cursor"]


def _line(cloud: Cloud, reader: Reader, row: dict[str, Any]) -> dict[str, Any]:
    message, data = reader.read(row["node"], Veiled.decode(row["data"]))
    if isinstance(message, Peak):
        known = peak_row(row["node"], message, data) | {"cursor": row["cursor"]}
        return event_shape(known, cloud.feed.ids)
    return block_shape(row["node"], message)
