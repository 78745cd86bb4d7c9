"""Subjects by pseudonym: how much is stored of each, and all data of one."""

import asyncio
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from operator import itemgetter
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import Connection, RowMapping, Table, exists, func, select
from starlette.responses import Response, StreamingResponse

from eskin.errors import NoKeyError, QueryError
from eskin.wire.frames import EncodedFrame, Frame
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.api.dependencies import Access, Administrator, BiometricReader, CloudState
from eskin_cloud.api.problems import REFUSALS, REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json
from eskin_cloud.app_state import AppState
from eskin_cloud.privacy.key_access import RequestReader
from eskin_cloud.privacy.sealed_rows import event_rows, open_row
from eskin_cloud.schemas.access import SubjectDocument
from eskin_cloud.schemas.base import NoQuery, PageDocument, dump, page
from eskin_cloud.schemas.events import describe_columns, describe_event
from eskin_cloud.store.damage import are_countable
from eskin_cloud.store.descriptions import find_layout
from eskin_cloud.store.read.lookup import UnknownChannelError
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.node_key import of_same_node
from eskin_cloud.store.schema.sealed_tables import erased_subjects, sealed_messages, subject_nodes
from eskin_cloud.store.schema.tables import node_sites
from eskin_cloud.store.write.audit_log import Action, AuditEntry, record

router = APIRouter(tags=["subjects"])

_LINES: Final = "application/x-ndjson"


@router.get("/subjects", response_model=PageDocument[SubjectDocument], responses=REFUSALS)
def get_subjects(
    cloud: CloudState, _: Administrator, query: Annotated[NoQuery, Query()]
) -> Response:
    """List the subjects, by pseudonym, with their nodes and stored messages.

    Where rows of sealed messages are damaged, `messages` is null.
    """
    del query
    v = sealed_messages.c
    counted = select(v.node, v.subject, func.count()).group_by(v.slot, v.node, v.subject)
    with cloud.store.read() as connection:
        sites = dict(_sites(connection))
        held: Counter[tuple[str, str]] = Counter()
        countable = are_countable(sealed_messages.name)
        for node, subject, messages in connection.execute(counted) if countable else ():
            if node in sites:
                held[sites[node], subject] += messages
        erased = intact_rows(connection, erased_subjects, _all(connection, erased_subjects))
        gone = {(row["site"], row["subject"]): row["erased"] for row in erased}
        worn: dict[tuple[str, str], list[str]] = {}
        wore = intact_rows(connection, subject_nodes, _all(connection, subject_nodes))
        for row in wore:
            if row["node"] in sites:
                worn.setdefault((sites[row["node"]], row["subject"]), []).append(row["node"])
    items = [
        {
            "id": place[1],
            "site": place[0],
            "nodes": worn.get(place, []),
            "messages": held[place] if countable else None,
            "erased": None if place not in gone else format_timestamp(gone[place]),
        }
        for place in sorted(held.keys() | gone.keys() | worn.keys(), key=itemgetter(1, 0))
    ]
    return as_json(page(items, None))


def _sites(connection: Connection) -> Iterator[tuple[str, str]]:
    """Each node with its site."""
    for row in intact_rows(connection, node_sites, _all(connection, node_sites)):
        yield row["node"], row["site"]


def _all(connection: Connection, table: Table) -> Iterable[RowMapping]:
    """All rows, in the order of their keys."""
    return connection.execute(select(table).order_by(*table.primary_key.columns)).mappings()


class SubjectExportQuery(BaseModel):
    """Of which site the subject is."""

    model_config = ConfigDict(extra="forbid")

    site: str | None = Field(
        default=None, max_length=100, description="needed where several sites have that pseudonym"
    )


@router.get(
    "/subjects/{subject}/export",
    response_class=StreamingResponse,
    responses={200: {"content": {_LINES: {}}}, **REFUSALS_OF_PLACE},
)
async def get_export(
    cloud: CloudState,
    access: BiometricReader,
    subject: str,
    query: Annotated[SubjectExportQuery, Query()],
) -> Response:
    """Export all that is stored about a subject.

    Each line is the samples of a channel in a frame, or an event in JSON, in the order of storing.
    A line with `damaged` stands for a message that is damaged in the store.
    """
    reader = RequestReader(cloud.key_access.require(access.holder.scopes), access.opened)
    site = await asyncio.to_thread(_require_site, cloud, subject, query.site)
    audit_entry = AuditEntry(
        access.actor.name, access.actor.address, Action.SUBJECT_EXPORTED, subject, site
    )
    written = cloud.store.write(lambda c: record(c, audit_entry, now=cloud.clock()))
    await asyncio.wrap_future(written)
    lines = stream_lines(cloud, access, reader, site, subject)
    return StreamingResponse(lines, media_type=_LINES)


def _require_site(cloud: AppState, subject: str, site: str | None) -> str:
    """The site of a subject whose key is here."""
    with cloud.store.read() as connection:
        cloud.key_access.apply_erasures(connection)
        rows = connection.execute(select(node_sites.c.site).distinct())
        sites = [each for each in rows.scalars() if site in {None, each}]
    refusal = f"subject {subject[:100]} has no key here"
    found: list[str] = []
    for each in sites:
        try:
            cloud.key_access.of(each).find(subject)
            found.append(each)
        except NoKeyError as error:
            refusal = str(error)[:200] if error.erased else refusal
    if len(found) > 1:
        raise QueryError("site", f"several have that subject: {', '.join(sorted(found))}; name one")
    if not found:
        raise UnknownChannelError("subject", refusal)
    return found[0]


def stream_lines(
    cloud: AppState, access: Access, reader: RequestReader, site: str, subject: str
) -> Iterator[bytes]:
    """A subject's lines, for as long as the reader may read."""
    last = -1
    is_own = exists().where(of_same_node(node_sites, sealed_messages), node_sites.c.site == site)
    while True:
        query = select(sealed_messages).where(
            sealed_messages.c.subject == subject,
            sealed_messages.c.cursor > last,
            is_own,
        )
        with cloud.store.read() as connection:
            cloud.key_access.apply_erasures(connection)
            rows = (
                connection.execute(query.order_by(sealed_messages.c.cursor).limit(200))
                .mappings()
                .all()
            )
        if not rows:
            return
        for row in rows:
            access.require()
            for line in _lines(cloud, reader, dict(row)):
                yield dump(line) + b"\n"
        last = rows[-1]["cursor"]


def _lines(
    cloud: AppState, reader: RequestReader, row: dict[str, Any]
) -> list[Mapping[str, object]]:
    node = row["node"]
    opened = open_row(reader, row)
    if opened is None:
        place = {"node": node, "boot": row["boot"], "sequence": row["sequence"]}
        return [{"damaged": True, **place}]
    message, data = opened
    with cloud.store.read() as connection:
        described = find_layout(connection, node, message.layout)
    if isinstance(message, EncodedFrame):
        return list(describe_columns(node, Frame.decode(data), described))
    rows = event_rows(node, message, data, described, row["cursor"])
    return [describe_event(each, cloud.feed.ids) for each in rows]
