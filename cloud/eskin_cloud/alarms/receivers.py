"""Receivers of alarms: webhooks and a Prometheus Alertmanager.

Each has its place in the numbers of transitions (`schema.alarm_tables.alarm_receivers`), which is
written after it has answered. So it is given each transition at least once, in their order.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import ssl
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import httpx
from sqlalchemy import delete, func, insert, select, update

from eskin.errors import EskinError, SettingsError
from eskin.wire.timestamp import SECOND, format_timestamp
from eskin_cloud.store.row_digests import intact_rows, require_intact_row
from eskin_cloud.store.schema.alarm_tables import (
    alarm_receivers,
    alarm_state,
    alarm_transitions,
    alarms,
    monitors,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.settings import AlarmsSection

ALERT_LASTS_NS: Final = 300 * SECOND
"""An Alertmanager clears an alert that it is not given again for so long."""
REPEAT_NS: Final = 60 * SECOND
"""How often an Alertmanager is given active alerts again."""
ALERTMANAGER: Final = "alertmanager"
WEBHOOK: Final = "webhook"
SITE: Final = "site "
"""Begins the name of the receiver that the gateways of a site are together."""
_AT_ONCE: Final = 100
_MOST_PUBLISHED: Final = 10_000
"""Changes that a gateway is given at once."""
_PREFIX: Final = "whsec_"


class ReceiverError(EskinError):
    """A receiver did not take what it was sent; it is sent it again."""


class Waiting(NamedTuple):
    """What a receiver has not been given.

    Attributes:
        row: The receiver's row.
        transitions: The next ones that are not silenced, in their order.
        last: The number of the last one that is stored.
    """

    row: RowMapping
    transitions: list[RowMapping]
    last: int


def register_receiver(connection: Connection, name: str, *, since: int | None = None) -> None:
    """Note a receiver; a new one is given what comes from now on, or after a number."""
    r = alarm_receivers.c
    if connection.execute(select(r.name).where(r.name == name)).first() is None:
        last = since
        if last is None:
            last = connection.execute(select(alarm_state.c.last_number)).scalar_one()
        row = {"name": name, "delivered": last, "attempts": 0, "given_up": 0}
        connection.execute(insert(alarm_receivers), row)


def receiver_names(settings: AlarmsSection) -> list[str]:
    """Names of the receivers that settings name."""
    names = [f"{WEBHOOK} {name}" for name in settings.webhooks]
    return names if settings.alertmanager is None else [*names, ALERTMANAGER]


def forget_receivers(connection: Connection, names: Sequence[str]) -> None:
    """Forget all receivers but those of some names, and the sites."""
    r = alarm_receivers.c
    gone = r.name.not_in(names) & r.name.not_like(f"{SITE}%")
    connection.execute(delete(alarm_receivers).where(gone))


def find_receiver(connection: Connection, name: str) -> RowMapping | None:
    """A receiver's row; ``None`` if it was never noted."""
    query = select(alarm_receivers).where(alarm_receivers.c.name == name)
    row = connection.execute(query).mappings().one_or_none()
    return require_intact_row(connection, alarm_receivers, row)


def list_receivers(connection: Connection) -> list[RowMapping]:
    """All receivers, by name."""
    query = select(alarm_receivers).order_by(alarm_receivers.c.name)
    return intact_rows(connection, alarm_receivers, connection.execute(query).mappings())


def count_waiting(connection: Connection, row: RowMapping) -> int:
    """How many transitions a receiver has not been given yet."""
    t = alarm_transitions.c
    query = select(func.count()).where(t.number > row["delivered"])
    if row["name"].startswith(SITE):
        site = row["name"].removeprefix(SITE)
        query = query.where(t.sites.contains(f" {site} ", autoescape=True))
    else:
        query = query.where(t.silenced == 0)
    return connection.execute(query).scalar_one()


def find_waiting(connection: Connection, name: str) -> Waiting | None:
    """What a receiver has not been given; ``None`` if it was never noted."""
    row = find_receiver(connection, name)
    if row is None:
        return None
    t = alarm_transitions.c
    query = select(alarm_transitions).where(t.number > row["delivered"], t.silenced == 0)
    query = query.order_by(t.number).limit(_AT_ONCE)
    rows = intact_rows(connection, alarm_transitions, connection.execute(query).mappings())
    last = connection.execute(select(alarm_state.c.last_number)).scalar_one()
    return Waiting(row, rows, last)


def find_for_site(
    connection: Connection, site: str, published: int | None
) -> list[tuple[int, str, str]]:
    """What a gateway publishes next: number, monitor and document of transitions.

    Args:
        connection: In a read transaction.
        site: Of the gateway.
        published: The last number that it has published; ``None`` where it has just started, and is
            given the latest state of each monitor of its site, too.
    """
    t = alarm_transitions.c
    here = t.sites.contains(f" {site} ", autoescape=True)
    query = select(alarm_transitions).where(here).order_by(t.number).limit(_MOST_PUBLISHED)
    if published is None:
        row = find_receiver(connection, f"{SITE}{site}")
        after = 0 if row is None else row["delivered"]
        named = t.monitor.in_(select(monitors.c.name))
        latest = select(func.max(t.number)).where(here, named).group_by(t.monitor)
        query = query.where((t.number > after) | t.number.in_(latest))
    else:
        query = query.where(t.number > published)
    rows = intact_rows(connection, alarm_transitions, connection.execute(query).mappings())
    return [(row["number"], row["monitor"], row["document"]) for row in rows]


def note_published(connection: Connection, site: str, number: int) -> None:
    """Note up to which number gateways of a site have published."""
    register_receiver(connection, f"{SITE}{site}", since=0)
    note_delivered(connection, f"{SITE}{site}", number)


def note_delivered(
    connection: Connection, name: str, number: int, *, given_up: bool = False
) -> None:
    """Note that a receiver has a transition and all before it, or that it is not given it."""
    r = alarm_receivers.c
    values: dict[str, Any] = {"given_up": r.given_up + 1}
    if not given_up:
        values = {"attempts": 0, "failing_since": None, "next_attempt": None, "error": None}
    query = update(alarm_receivers).where(r.name == name, r.delivered < number)
    connection.execute(query.values(delivered=number, **values))


def note_failure(
    connection: Connection, name: str, error: str, *, now: int, next_attempt: int
) -> None:
    """Note that a receiver did not take a transition."""
    r = alarm_receivers.c
    row = find_receiver(connection, name)
    if row is not None:
        since = now if row["failing_since"] is None else row["failing_since"]
        values = {"attempts": row["attempts"] + 1, "failing_since": since, "error": error}
        query = update(alarm_receivers).where(r.name == name)
        connection.execute(query.values(next_attempt=next_attempt, **values))


def active_alerts(connection: Connection, delivered: int, *, now: int) -> list[dict[str, Any]]:
    """Alerts of an Alertmanager: those of open alarms, and of those cleared since a transition.

    An alarm that is escalated is another alert, with the label ``escalated``; the first one ends.
    """
    a, t = alarms.c, alarm_transitions.c
    fresh = select(t.alarm).where(t.number > delivered, t.silenced == 0)
    query = select(alarms).where(a.notified == 1, a.cleared.is_(None) | a.id.in_(fresh))
    found = []
    for row in intact_rows(connection, alarms, connection.execute(query).mappings()):
        ends = now + ALERT_LASTS_NS if row["cleared"] is None else row["cleared"]
        if row["escalated"] is None:
            found.append(_alert(row, row["raised"], ends))
        else:
            found.append(_alert(row, row["raised"], row["escalated"]))
            found.append(_alert(row, row["escalated"], ends, escalated="true"))
    return found


def _alert(row: RowMapping, starts: int, ends: int, **labels: str) -> dict[str, Any]:
    labels |= {"alertname": row["monitor"], "severity": row["severity"], "alarm": str(row["id"])}
    return {
        "labels": labels,
        "annotations": {
            "summary": f"{row['monitor']}: {row['verdict']}",
            "formula": row["formula"],
            "began": format_timestamp(row["began"] // 2),
        },
        "startsAt": format_timestamp(starts),
        "endsAt": format_timestamp(ends),
    }


def read_secret(path: Path | None) -> bytes | None:
    """The secret that signs what webhooks are sent.

    Raises:
        SettingsError: The file cannot be used.
    """
    if path is None:
        return None
    try:
        text = path.read_text().strip()
        return base64.b64decode(text.removeprefix(_PREFIX), validate=True)
    except (OSError, UnicodeDecodeError, binascii.Error) as error:
        raise SettingsError(
            "alarms.webhook_secret_file",
            f"{path} cannot be used: {error}; write {_PREFIX} and base64 there",
        ) from error


def webhook_headers(key: str, body: bytes, secret: bytes | None, *, now: int) -> dict[str, str]:
    """Headers of what a webhook is sent (Standard Webhooks 1.0.0; Idempotency-Key of the IETF).

    Args:
        key: The same for each attempt.
        body: What is sent.
        secret: Signs it; ``None`` for no signature.
        now: UTC ns.
    """
    seconds = str(now // SECOND)
    headers = {
        "content-type": "application/json",
        "idempotency-key": f'"{key}"',
        "webhook-id": key,
        "webhook-timestamp": seconds,
    }
    if secret is not None:
        signed = hmac.digest(
            secret, b".".join([key.encode(), seconds.encode(), body]), hashlib.sha256
        )
        headers["webhook-signature"] = f"v1,{base64.b64encode(signed).decode()}"
    return headers


def make_client(root: Path | None, timeout_s: float) -> httpx.AsyncClient:
    """A client for receivers.

    Raises:
        SettingsError: The root certificate cannot be read.
    """
    try:
        context = ssl.create_default_context(cafile=None if root is None else str(root))
    except (OSError, ssl.SSLError) as error:
        raise SettingsError("alarms.root", f"{root} cannot be used: {error}") from error
    return httpx.AsyncClient(verify=context, timeout=timeout_s, trust_env=False)


async def post(client: httpx.AsyncClient, url: str, body: bytes, headers: dict[str, str]) -> None:
    """Post to a receiver, and require that it takes it. Of its answer only the status is read.

    Raises:
        ReceiverError: It cannot be reached, or answers another status than 2xx.
    """
    try:
        async with client.stream("POST", url, content=body, headers=headers) as answer:
            status = answer.status_code
    except httpx.HTTPError as error:
        raise ReceiverError(f"{type(error).__name__}: {error}") from error
    if not 200 <= status < 300:
        raise ReceiverError(f"it answered {status}")
