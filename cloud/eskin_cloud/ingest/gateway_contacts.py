"""What the cloud knows of its gateways: the status in a request's header, and their contacts.

Contacts are written behind their batches: rows of gateways are central.
"""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import orjson

from eskin.errors import StoreError
from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_cloud.store.write.gateways import ContactCounts, GatewayStatus, record_contact

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import Connection

    from eskin_cloud.store import Store
    from eskin_cloud.store.write.ingest import IngestResult

log = logging.getLogger(__name__)

HEADER: Final = "Eskin-Gateway-Status"
_LONGEST: Final = 1024
_MOST: Final = 2**62
"""Some counts are added up in 64 bit."""
_PAUSE_S: Final = 1.0
"""Between two writes: on Citus each commits on all servers in two phases."""


def read_status(header: str | None) -> GatewayStatus | None:
    """Read the header, a JSON object; ``None`` where it is absent.

    Raises:
        MalformedBatchError: It is malformed.
    """
    if header is None:
        return None
    names = ("messages", "bytes", "capacity_bytes", "oldest_ns", "dead_letters", "nodes")
    try:
        said = orjson.loads(header) if len(header) <= _LONGEST else None
    except orjson.JSONDecodeError:
        said = None
    if not isinstance(said, dict) or set(said) != set(names):
        raise MalformedBatchError(f"{HEADER} is no JSON object of {', '.join(names)}")
    for name, value in said.items():
        nothing = name == "oldest_ns" and value is None
        if not nothing and (type(value) is not int or not 0 <= value <= _MOST):
            raise MalformedBatchError(f"{HEADER}: {name} is {value!r}, no count up to {_MOST}")
    return GatewayStatus(*(said[name] for name in names))


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
