"""Erasure of subjects: destroy keys after notices to other clouds, and delete what is stored."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Final

from sqlalchemy import update

from eskin.wire.slot import SLOTS
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.removal import has_messages
from eskin_cloud.store.schema.sealed_tables import erased_subjects
from eskin_cloud.store.write.audit_log import Action, AuditEntry, record

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sqlalchemy import Connection

    from eskin_cloud.app_state import AppState

_INTERVAL_S: Final = 1.0


async def apply_erasures(cloud: AppState, stopping: asyncio.Event) -> None:
    """Look each second, so that keys are destroyed also where no request reads."""
    if cloud.key_access.keystore is not None:
        work = partial(asyncio.to_thread, _apply, cloud)
        await run_periodically(
            "erasures", work, cloud=cloud, stopping=stopping, every_s=_INTERVAL_S
        )


def _apply(cloud: AppState) -> None:
    with cloud.store.read() as connection:
        cloud.key_access.apply_erasures(connection)


async def pass_barrier(cloud: AppState) -> None:
    """Wait until each transaction has ended that may not know of an erasure.

    Ingest locks a slot, then looks for erased subjects. A transaction that begins after this
    knows of all erasures that were stored before, so what is deleted now does not come back.

    Raises:
        StoreError: The store cannot be written.
    """
    for slot in range(SLOTS):
        await asyncio.wrap_future(cloud.store.write_slots([slot], lambda *_: None))


async def record_outcome(cloud: AppState, erasures: Iterable[tuple[str, str]]) -> None:
    """Record that nothing is stored any more of erased subjects, as far as it is so.

    Args:
        cloud: The cloud.
        erasures: Site and subject of those that were stored before `pass_barrier`, and whose
            messages were deleted after it.

    Raises:
        StoreError: The store cannot be read or written.
    """

    def find() -> list[tuple[str, str]]:
        with cloud.store.read() as connection:
            return [each for each in erasures if not has_messages(connection, *each)]

    removed = await asyncio.to_thread(find)

    def work(connection: Connection) -> None:
        now, e = cloud.clock(), erased_subjects.c
        for site, subject in removed:
            here = (e.site == site) & (e.subject == subject) & e.removed.is_(None)
            if connection.execute(update(erased_subjects).where(here).values(removed=now)).rowcount:
                entry = AuditEntry("", "", Action.SUBJECT_REMOVED, subject, site)
                record(connection, entry, now=now)

    if removed:
        await asyncio.wrap_future(cloud.store.write(work))
