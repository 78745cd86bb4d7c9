"""Monitors that the cloud evaluates live."""

import asyncio
import re
from typing import Annotated, Final, Literal

from fastapi import APIRouter, Depends, Path, Query
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import Connection, RowMapping
from starlette.responses import Response

from eskin.errors import MonitorError, QueryError, shown
from eskin.monitor import check
from eskin.privacy import is_biometric
from eskin.runtime.http_server.problems import documented
from eskin.wire.messages.command import MOST_FORMULA
from eskin.wire.timestamp import SECOND
from eskin_cloud.alarms.live_monitor import MOST_KEPT
from eskin_cloud.api.dependencies import Access, CloudState, Operator, Reader
from eskin_cloud.api.problems import REFUSALS, REFUSALS_OF_PLACE
from eskin_cloud.app_state import AppState
from eskin_cloud.query.formula_channels import channel_places, parse_formula
from eskin_cloud.schemas.alarms import LiveVerdictDocument, MonitorDocument
from eskin_cloud.schemas.base import NoQuery, PageDocument, PageQuery, instant
from eskin_cloud.store.read.lookup import UnknownChannelError, find_channel
from eskin_cloud.store.write.alarms import (
    DEFINED,
    DELETED,
    clear_alarm,
    note_definition,
    open_alarms,
)
from eskin_cloud.store.write.audit_log import Action, AuditEntry, record
from eskin_cloud.store.write.monitors import (
    MonitorDefinition,
    delete_monitor,
    find_monitor,
    list_monitors,
    put_monitor,
    silence_monitor,
)

router = APIRouter(tags=["monitors"])

_STRICT: Final = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
_TAKEN: Final = frozenset({"evaluation"})
_NAME: Final = "[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?"


def require_name(
    monitor: Annotated[str, Path(max_length=1000, json_schema_extra={"pattern": f"^{_NAME}$"})],
) -> str:
    """Require a name that a monitor may have.

    Raises:
        QueryError: It is none.
    """
    if re.fullmatch(_NAME, monitor) is None:
        raise QueryError(
            "monitor",
            f"{shown(monitor)} is no name; write at most 63 small letters, digits and dashes, such "
            "as left-grip",
        )
    if monitor in _TAKEN:
        raise QueryError("monitor", f"{monitor!r} is taken by this API; choose another name")
    return monitor


MonitorName = Annotated[str, Depends(require_name)]


class MonitorBody(BaseModel):
    """What a monitor is."""

    model_config = _STRICT

    formula: str = Field(
        min_length=1,
        max_length=MOST_FORMULA,
        description="signal temporal logic over channels, with bounded windows",
        examples=["once[0,2s] t01.capacitance > 90 pF"],
    )
    node: str | None = Field(
        default=None,
        max_length=63,
        description='of channels without one; others are "NODE/CHANNEL", in double quotes',
    )
    raise_on: Literal["never", "possible", "certain"] = Field(
        default="certain", description="the least verdict that raises an alarm"
    )
    missing: bool = Field(
        default=False,
        description="whether missing samples, and nodes that are silent, count for possible",
    )
    severity: str = Field(
        default="warning",
        pattern=r"^[A-Za-z0-9_-]{1,32}$",
        description="what receivers are given with it",
    )
    clear_after_s: float = Field(
        default=1.0,
        ge=0,
        le=86_400,
        description="seconds that the formula must be impossible until the alarm is cleared",
    )
    escalate_after_s: float | None = Field(
        default=None,
        ge=0,
        le=2_592_000,
        description="seconds after which an alarm that is not acknowledged is escalated",
    )

    def definition(self) -> MonitorDefinition:
        """As it is stored."""
        return MonitorDefinition(
            formula=self.formula,
            node=self.node,
            raise_on=self.raise_on,
            missing=self.missing,
            severity=self.severity,
            clear_after=round(self.clear_after_s * SECOND),
            escalate_after=(
                None if self.escalate_after_s is None else round(self.escalate_after_s * SECOND)
            ),
        )

    def nodes(self) -> set[str]:
        """The nodes whose channels it reads."""
        places = channel_places(parse_formula(self.formula), self.node)
        return {node for node, _ in places.values()}


class SilenceBody(BaseModel):
    """How long a monitor is silenced."""

    model_config = _STRICT

    seconds: float = Field(gt=0, le=31_536_000, description="from now on")


@router.get("/monitors", responses=REFUSALS)
def get_monitors(
    cloud: CloudState, _: Reader, query: Annotated[PageQuery, Query()]
) -> PageDocument[MonitorDocument]:
    """List the monitors that are evaluated live, by name."""
    ids = cloud.feed.ids
    after = "" if query.cursor is None else ids.read_name(query.cursor)
    with cloud.store.read() as connection:
        rows = list_monitors(connection, after=after, limit=query.limit + 1)
        raised = {alarm["monitor"]: alarm["id"] for alarm in open_alarms(connection)}
    shown = rows[: query.limit]
    following = ids.write_name(shown[-1]["name"]) if len(rows) > len(shown) else None
    items = [_describe(cloud, row, raised.get(row["name"])) for row in shown]
    return PageDocument(items=items, next=following)


@router.get("/monitors/{monitor}", responses=REFUSALS_OF_PLACE)
def get_monitor(
    cloud: CloudState, _: Reader, monitor: MonitorName, query: Annotated[NoQuery, Query()]
) -> MonitorDocument:
    """Read a monitor, its latest verdict and its open alarm."""
    del query
    return _read(cloud, monitor)


@router.put("/monitors/{monitor}", responses=REFUSALS_OF_PLACE | documented(408, 413))
async def put_monitor_definition(
    cloud: CloudState,
    access: Operator,
    monitor: MonitorName,
    body: MonitorBody,
    query: Annotated[NoQuery, Query()],
) -> MonitorDocument:
    """Define a monitor; it is evaluated from now on.

    Where a definition of the name differs, its open alarm is cleared first. The same definition
    changes nothing.
    """
    del query
    await asyncio.to_thread(_require_usable, cloud, body)
    definition, nodes = body.definition(), body.nodes()

    def work(connection: Connection) -> None:
        now = cloud.clock()
        before, after = put_monitor(connection, monitor, definition, now=now)
        if before is not None and before["revision"] == after["revision"]:
            return
        _clear_alarms(connection, monitor, now)
        note_definition(connection, after, nodes, DEFINED, now=now)
        detail = f"revision {after['revision']}: {definition.formula}"
        record(connection, _entry(access, Action.MONITOR_DEFINED, monitor, detail), now=now)

    await asyncio.wrap_future(cloud.store.write(work))
    cloud.notifier.wake()
    return await asyncio.to_thread(_read, cloud, monitor)


@router.delete("/monitors/{monitor}", status_code=204, responses=REFUSALS_OF_PLACE)
async def remove_monitor(
    cloud: CloudState, access: Operator, monitor: MonitorName, query: Annotated[NoQuery, Query()]
) -> Response:
    """Delete a monitor; its open alarm is cleared, and its alarms stay."""
    del query

    def work(connection: Connection) -> None:
        now = cloud.clock()
        row = delete_monitor(connection, monitor)
        if row is None:
            raise _unknown(monitor)
        _clear_alarms(connection, monitor, now)
        places = channel_places(parse_formula(row["formula"]), row["node"])
        nodes = {node for node, _ in places.values()}
        note_definition(connection, row, nodes, DELETED, now=now)
        record(connection, _entry(access, Action.MONITOR_DELETED, monitor), now=now)

    await asyncio.wrap_future(cloud.store.write(work))
    cloud.notifier.wake()
    return Response(status_code=204)


@router.put("/monitors/{monitor}/silence", responses=REFUSALS_OF_PLACE | documented(408, 413))
async def put_silence(
    cloud: CloudState,
    access: Operator,
    monitor: MonitorName,
    body: SilenceBody,
    query: Annotated[NoQuery, Query()],
) -> MonitorDocument:
    """Silence a monitor: receivers are not given its alarms until then.

    An alarm that is still open then is given, and is escalated no earlier.
    """
    del query
    return await _silence(cloud, access, monitor, round(body.seconds * SECOND))


@router.delete("/monitors/{monitor}/silence", responses=REFUSALS_OF_PLACE)
async def delete_silence(
    cloud: CloudState, access: Operator, monitor: MonitorName, query: Annotated[NoQuery, Query()]
) -> MonitorDocument:
    """End a monitor's silence."""
    del query
    return await _silence(cloud, access, monitor, None)


async def _silence(
    cloud: AppState, access: Access, monitor: str, span: int | None
) -> MonitorDocument:
    def work(connection: Connection) -> None:
        now = cloud.clock()
        until = None if span is None else now + span
        if not silence_monitor(connection, monitor, until):
            raise _unknown(monitor)
        detail = f"until {instant(until) or 'now'}"
        record(connection, _entry(access, Action.MONITOR_SILENCED, monitor, detail), now=now)

    await asyncio.wrap_future(cloud.store.write(work))
    return await asyncio.to_thread(_read, cloud, monitor)


def _require_usable(cloud: AppState, body: MonitorBody) -> None:
    """Check that a live monitor can evaluate a formula.

    Raises:
        QueryError: It does not fit its channels, or needs too many samples.
        UnknownChannelError: A channel is unknown.
    """
    formula = parse_formula(body.formula)
    places = channel_places(formula, body.node)
    for node, channel in places.values():
        if is_biometric(channel):
            raise QueryError(
                "formula",
                f"{node}/{channel} is biometric, and alarms would show it; leave it out",
            )
    if body.missing and body.raise_on != "possible":
        raise QueryError("missing", 'counts for possible only; set raise_on to "possible"')
    with cloud.store.read() as connection:
        rows = {name: find_channel(connection, *place) for name, place in places.items()}
    try:
        past, future = check(formula, {n: row["unit"] for n, row in rows.items()}, bounded=True)
    except MonitorError as error:
        raise QueryError("formula", str(error)) from error
    for name, row in rows.items():
        count = ((past or 0) + (future or 0)) // max(row["dt"], 1)
        if count > MOST_KEPT // 2:
            raise QueryError(
                "formula",
                f"its windows hold {count} samples of {name}, and live monitors keep "
                f"{MOST_KEPT // 2}; shorten them, or ask /api/v1/monitors/evaluation",
            )


def _clear_alarms(connection: Connection, monitor: str, now: int) -> None:
    for alarm in open_alarms(connection, monitor):
        clear_alarm(connection, alarm, now=now)


def _read(cloud: AppState, name: str) -> MonitorDocument:
    with cloud.store.read() as connection:
        row = find_monitor(connection, name)
        raised = open_alarms(connection, name)
    if row is None:
        raise _unknown(name)
    return _describe(cloud, row, raised[0]["id"] if raised else None)


def _describe(cloud: AppState, row: RowMapping, alarm: int | None) -> MonitorDocument:
    live = cloud.evaluator.find(row["name"])
    latest, problem = None, None
    if live is not None and live.revision == row["revision"]:
        problem = live.problem
        if live.latest is not None:
            latest = LiveVerdictDocument.model_validate(
                {
                    "verdict": live.latest.verdict.name.lower(),
                    "missing": live.latest.missing,
                    "until": (live.latest.last + 1) // 2,
                }
            )
    after = row["escalate_after"]
    return MonitorDocument(
        name=row["name"],
        formula=row["formula"],
        node=row["node"],
        raise_on=row["raise_on"],
        missing=bool(row["missing"]),
        severity=row["severity"],
        clear_after_s=row["clear_after"] / SECOND,
        escalate_after_s=None if after is None else after / SECOND,
        silenced_until=instant(row["silenced_until"]),
        created=row["created"],
        changed=row["changed"],
        revision=row["revision"],
        latest=latest,
        problem=problem,
        alarm=alarm,
    )


def _unknown(name: str) -> UnknownChannelError:
    return UnknownChannelError("monitor", f"{name!r} is not known; GET /api/v1/monitors lists all")


def _entry(access: Access, action: Action, target: str, detail: str = "") -> AuditEntry:
    return AuditEntry(access.actor.name, access.actor.address, action, target, detail)
