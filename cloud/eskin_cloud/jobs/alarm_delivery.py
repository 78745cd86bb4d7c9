"""Deliver alarms to the receivers of the settings, each at its own pace."""

from __future__ import annotations

import asyncio
import logging
import math
import random
import time
from abc import ABC, abstractmethod
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import orjson

from eskin.wire.timestamp import SECOND
from eskin_cloud.alarms.receivers import (
    ALERTMANAGER,
    REPEAT_NS,
    WEBHOOK,
    ReceiverError,
    active_alerts,
    find_waiting,
    make_client,
    note_delivered,
    note_failure,
    post,
    read_secret,
    register_receiver,
    webhook_headers,
)
from eskin_cloud.jobs.periodic import run_periodically

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.alarms.receivers import Waiting
    from eskin_cloud.app_state import AppState

log = logging.getLogger(__name__)

_LOOK_S: Final = 1.0
_PAUSE_S: Final = 0.05
_NOTED_AT_ONCE: Final = 10
"""Changes that are delivered before it is noted: so many may come again after a kill."""
_FIRST_RETRY_S: Final = 1.0
_MOST_DOUBLINGS: Final = 20


def deliver_alarms(cloud: AppState, stopping: asyncio.Event) -> list[Coroutine[Any, Any, None]]:
    """A job for each receiver.

    Raises:
        SettingsError: The root certificate or the secret cannot be read.
    """
    settings = cloud.settings.alarms
    receivers: list[_Receiver] = []
    secret = read_secret(settings.webhook_secret_file) if settings.webhooks else None
    for name, url in settings.webhooks.items():
        receivers.append(_Webhook(cloud, f"{WEBHOOK} {name}", url, secret))
    if settings.alertmanager is not None:
        url = f"{settings.alertmanager.rstrip('/')}/api/v2/alerts"
        receivers.append(_Alertmanager(cloud, ALERTMANAGER, url))
    return [
        run_periodically(
            f"alarms to {each.name}", each.step, cloud=cloud, stopping=stopping, every_s=_PAUSE_S
        )
        for each in receivers
    ]


class _Receiver(ABC):
    def __init__(self, cloud: AppState, name: str, url: str) -> None:
        self.name = name
        self._cloud = cloud
        self._url = url
        self._registered = False
        settings = cloud.settings.alarms
        self._client = make_client(settings.root, settings.timeout_s)

    async def step(self) -> None:
        """Deliver what waits, or wait for something.

        Raises:
            StoreError: The store cannot be used.
        """
        cloud, version = self._cloud, self._cloud.notifier.version
        if not cloud.evaluator.leads:
            await asyncio.sleep(_LOOK_S)
            return
        if not self._registered:
            await self._write(partial(register_receiver, name=self.name))
            self._registered = True
        waiting = await asyncio.to_thread(self._find)
        if waiting is None or self._pauses(waiting.row):
            await asyncio.sleep(_LOOK_S)
        elif not await self._deliver(waiting):
            await cloud.notifier.wait(version, _LOOK_S)

    def _pauses(self, row: RowMapping) -> bool:
        """Whether the next attempt is later; not if only a clock that has jumped says so."""
        longest = round(self._cloud.settings.alarms.retry_max_s * SECOND)
        due, now = row["next_attempt"], self._cloud.clock()
        return due is not None and now < int(due) <= now + longest

    @abstractmethod
    async def _deliver(self, waiting: Waiting) -> bool:
        """Deliver what waits; returns whether there was anything."""

    async def _post(self, body: bytes, headers: dict[str, str]) -> str | None:
        """Post; returns why it failed."""
        try:
            async with asyncio.timeout(self._cloud.settings.alarms.timeout_s):
                await post(self._client, self._url, body, headers)
        except (ReceiverError, TimeoutError) as error:
            return str(error) or "it did not answer in time"
        return None

    async def _failed(self, error: str, *, attempts: int) -> None:
        settings, now = self._cloud.settings.alarms, self._cloud.clock()
        pause = _FIRST_RETRY_S * 2.0 ** min(attempts, _MOST_DOUBLINGS)
        pause = min(pause, settings.retry_max_s) * random.uniform(0.8, 1.0)  # noqa: S311 - no secret
        if attempts == 0:
            log.warning("alarms are not delivered: receiver=%s reason=%s", self.name, error)
        at = now + round(pause * SECOND)
        await self._write(
            partial(note_failure, name=self.name, error=error, now=now, next_attempt=at)
        )

    def _find(self) -> Waiting | None:
        with self._cloud.store.read() as connection:
            return find_waiting(connection, self.name)

    async def _write(self, work: Callable[[Connection], None]) -> None:
        await asyncio.wrap_future(self._cloud.store.write(work))


class _Webhook(_Receiver):
    """Is sent each transition in their order."""

    def __init__(self, cloud: AppState, name: str, url: str, secret: bytes | None) -> None:
        super().__init__(cloud, name, url)
        self._secret = secret

    async def _deliver(self, waiting: Waiting) -> bool:
        taken = None
        for transition in waiting.transitions[:_NOTED_AT_ONCE]:
            error = await self._send(transition)
            if error is not None:
                break
            taken = transition["number"]
        else:
            transition, error = None, None
        if taken is not None:
            await self._write(partial(note_delivered, name=self.name, number=taken))
        if transition is not None and error is not None:
            await self._refused(waiting, transition, error, fresh=taken is not None)
        return bool(waiting.transitions)

    async def _send(self, transition: RowMapping) -> str | None:
        """Send a change; returns why that failed."""
        body = transition["document"].encode()
        key = f"eskin-{transition['alarm']}-{transition['number']}"
        headers = webhook_headers(key, body, self._secret, now=self._cloud.clock())
        return await self._post(body, headers)

    async def _refused(
        self, waiting: Waiting, transition: RowMapping, error: str, *, fresh: bool
    ) -> None:
        if not self._gives_up(transition):
            await self._failed(error, attempts=0 if fresh else waiting.row["attempts"])
            return
        number = transition["number"]
        log.error(
            "alarm was not delivered: receiver=%s transition=%d reason=%s",
            *(self.name, number, error),
        )
        self._cloud.metrics.alarms_given_up.labels(self.name).inc()
        await self._write(partial(note_delivered, name=self.name, number=number, given_up=True))

    def _gives_up(self, transition: RowMapping) -> bool:
        longest = round(self._cloud.settings.alarms.give_up_h * 3600 * SECOND)
        return self._cloud.clock() - int(transition["time"]) >= longest


class _Alertmanager(_Receiver):
    """Is sent all active alerts again and again, and those that have ended once."""

    _sent = -math.inf

    async def _deliver(self, waiting: Waiting) -> bool:
        now = self._cloud.clock()
        if not waiting.transitions and time.monotonic() - self._sent < REPEAT_NS / SECOND:
            return False

        def find() -> list[dict[str, Any]]:
            with self._cloud.store.read() as connection:
                return active_alerts(connection, waiting.row["delivered"], now=now)

        alerts = await asyncio.to_thread(find)
        headers = {"content-type": "application/json"}
        error = await self._post(orjson.dumps(alerts), headers) if alerts else None
        if error is not None:
            await self._failed(error, attempts=waiting.row["attempts"])
            return True
        self._sent = time.monotonic()
        if waiting.row["delivered"] < waiting.last:
            await self._write(partial(note_delivered, name=self.name, number=waiting.last))
        return bool(waiting.transitions)
