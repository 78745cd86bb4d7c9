"""Alarms of monitors, and who is given them."""

import asyncio
from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query
from pydantic import Field
from sqlalchemy import Connection

from eskin.wire.messages.cbor_map import MOST_COUNT
from eskin_cloud.alarms.receivers import count_waiting, list_receivers
from eskin_cloud.api.dependencies import CloudState, Operator, Reader
from eskin_cloud.api.problems import REFUSALS, REFUSALS_OF_PLACE
from eskin_cloud.schemas.alarms import (
    AlarmDocument,
    AlarmHistoryDocument,
    ReceiverDocument,
    describe_receiver,
    describe_transition,
)
from eskin_cloud.schemas.base import NoQuery, PageDocument, PageQuery
from eskin_cloud.store.read.lookup import UnknownChannelError
from eskin_cloud.store.write.alarms import (
    acknowledge_alarm,
    describe_alarm,
    find_alarm,
    list_alarms,
    list_transitions,
)
from eskin_cloud.store.write.audit_log import Action, AuditEntry, record

router = APIRouter(tags=["alarms"])

AlarmId = Annotated[int, Path(ge=1, le=MOST_COUNT)]


class AlarmsQuery(PageQuery):
    """Which alarms are listed."""

    monitor: str | None = Field(default=None, max_length=63, description="of this monitor only")
    state: Literal["raised", "cleared"] | None = Field(
        default=None, description="only those that are raised now, or that are cleared"
    )


@router.get("/alarms", responses=REFUSALS)
def get_alarms(
    cloud: CloudState, _: Reader, query: Annotated[AlarmsQuery, Query()]
) -> PageDocument[AlarmDocument]:
    """List alarms, the latest first."""
    ids = cloud.feed.ids
    before = None if query.cursor is None else ids.read(query.cursor, 1)[0]
    with cloud.store.read() as connection:
        rows = list_alarms(
            connection,
            before=before,
            limit=query.limit + 1,
            monitor=query.monitor,
            is_open=None if query.state is None else query.state == "raised",
        )
    shown = rows[: query.limit]
    following = ids.write(shown[-1]["id"]) if len(rows) > len(shown) else None
    return PageDocument(items=[AlarmDocument.of(row) for row in shown], next=following)


@router.get("/alarms/{alarm}", responses=REFUSALS_OF_PLACE)
def get_alarm(
    cloud: CloudState, _: Reader, alarm: AlarmId, query: Annotated[NoQuery, Query()]
) -> AlarmHistoryDocument:
    """Read an alarm with all of its changes."""
    del query
    with cloud.store.read() as connection:
        row = find_alarm(connection, alarm)
        if row is None:
            raise _unknown(alarm)
        changes = [describe_transition(each) for each in list_transitions(connection, alarm)]
    return AlarmHistoryDocument.model_validate(describe_alarm(row) | {"transitions": changes})


@router.post("/alarms/{alarm}/acknowledgement", responses=REFUSALS_OF_PLACE)
async def post_acknowledgement(
    cloud: CloudState, access: Operator, alarm: AlarmId, query: Annotated[NoQuery, Query()]
) -> AlarmDocument:
    """Acknowledge an alarm, so that it is not escalated.

    An alarm that is acknowledged already stays as it is.
    """
    del query

    def work(connection: Connection) -> AlarmDocument:
        now, actor = cloud.clock(), access.actor
        before = find_alarm(connection, alarm)
        row = acknowledge_alarm(connection, alarm, actor=actor.name, now=now)
        if row is None or before is None:
            raise _unknown(alarm)
        if before["acknowledged"] is None:
            entry = AuditEntry(
                actor.name, actor.address, Action.ALARM_ACKNOWLEDGED, str(alarm), row["monitor"]
            )
            record(connection, entry, now=now)
        return AlarmDocument.of(row)

    found = await asyncio.wrap_future(cloud.store.write(work))
    cloud.notifier.wake()
    return found


@router.get("/receivers", responses=REFUSALS)
def get_receivers(
    cloud: CloudState, _: Reader, query: Annotated[NoQuery, Query()]
) -> PageDocument[ReceiverDocument]:
    """List who is given alarms, how far, and what fails."""
    del query
    with cloud.store.read() as connection:
        items = [
            describe_receiver(row, count_waiting(connection, row))
            for row in list_receivers(connection)
        ]
    return PageDocument(items=items, next=None)


def _unknown(number: int) -> UnknownChannelError:
    return UnknownChannelError("alarm", f"there is no alarm {number}; GET /api/v1/alarms lists all")
