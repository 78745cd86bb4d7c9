"""Hearing of erasures that another cloud was told: from the store that all of them share."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Final

from sqlalchemy import func, select

from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.row_digests import sound
from eskin_cloud.store.schema.sealed_tables import erased_subjects

if TYPE_CHECKING:
    from collections.abc import Collection
    from collections.abc import Set as AbstractSet

    from sqlalchemy import Connection

    from eskin_cloud.app_state import AppState

_INTERVAL_S: Final = 1.0


def unapplied_erasures(
    connection: Connection, known: AbstractSet[tuple[str, str]]
) -> set[tuple[str, str]]:
    """Erased subjects, each with its site, that are not known; the store forgets none."""
    counted = select(func.count()).select_from(erased_subjects)
    if connection.execute(counted).scalar_one() <= len(known):
        return set()
    rows = connection.execute(select(erased_subjects)).mappings()
    found = sound(connection, erased_subjects, rows)
    return {(row["site"], row["subject"]) for row in found} - known


async def hear(cloud: AppState, stopping: asyncio.Event) -> None:
    """Look each second until told to stop, so that a key goes where nobody asks for it, too."""
    if cloud.key_access.keystore is not None:
        work = partial(asyncio.to_thread, look, cloud)
        await run_periodically(
            "erasures", work, cloud=cloud, stopping=stopping, every_s=_INTERVAL_S
        )


def find_erased(connection: Connection, site: str, subjects: Collection[str]) -> set[str]:
    """Which of some subjects of a site the store says were erased."""
    e = erased_subjects.c
    query = select(e.subject).where(e.site == site, e.subject.in_(sorted(subjects)))
    return set(connection.execute(query).scalars())


def look(cloud: AppState) -> None:
    """Look once, and destroy the cloud's copies of what is erased.

    Raises:
        StoreError: The store cannot be read.
        PrivacyError: A copy cannot be destroyed.
    """
    with cloud.store.read() as connection:
        cloud.key_access.heed(connection)
