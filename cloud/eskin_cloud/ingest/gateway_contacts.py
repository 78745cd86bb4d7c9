"""Contacts of gateways, written behind their batches: rows of gateways are central."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from eskin.errors import StoreError
from eskin_cloud.store.write.gateways import ContactCounts, record_contact

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import Connection

    from eskin_cloud.store import Store
    from eskin_cloud.store.write.gateways import GatewayStatus
    from eskin_cloud.store.write.ingest import IngestResult

log = logging.getLogger(__name__)

_PAUSE_S: Final = 1.0
"""Between two writes: on Citus each commits on all servers in two phases."""


@dataclass(slots=True)
class _Contact:
    site: str
    now: int
    condition: GatewayStatus | None = None
    counts: ContactCounts = field(default_factory=ContactCounts)


class GatewayContacts:
    """Writes the latest contact of each gateway, and what its batches came to.

    A batch is answered before. A write takes what came in the second before.

    Args:
        store: Where it is written.
        clock: UTC ns.
    """

    def __init__(self, store: Store, clock: Callable[[], int]) -> None:
        self._store = store
        self._clock = clock
        self._noted: dict[str, _Contact] = {}
        self._task: asyncio.Task[None] | None = None
        self._awaited = asyncio.Event()

    def note(
        self,
        gateway: str,
        *,
        site: str,
        condition: GatewayStatus | None,
        outcome: IngestResult,
    ) -> None:
        """Note a stored batch; on the event loop only.

        Args:
            gateway: Name of the one that sent it.
            site: Its site.
            condition: Its reported status, if any.
            outcome: The result.
        """
        now = self._clock()
        contact = self._noted.setdefault(gateway, _Contact(site, now))
        contact.now = now
        contact.condition = condition or contact.condition
        contact.counts.add(outcome)
        if self._task is None:
            self._task = asyncio.create_task(self._write())

    async def written(self) -> None:
        """Wait until what was noted is written, without a pause."""
        if self._task is not None:
            self._awaited.set()
            await self._task
            self._awaited.clear()

    async def _write(self) -> None:
        try:
            while self._noted:
                noted, self._noted = self._noted, {}

                def work(connection: Connection, noted: dict[str, _Contact] = noted) -> None:
                    for gateway, each in noted.items():
                        record_contact(
                            connection,
                            gateway,
                            site=each.site,
                            condition=each.condition,
                            now=each.now,
                            counts=each.counts,
                        )

                await asyncio.wrap_future(self._store.write(work, shared=True))
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._awaited.wait(), _PAUSE_S)
        except StoreError as error:  # the next batch states a contact again
            log.warning("contact of gateways not stored: reason=%s", error)
        finally:
            self._task = None
