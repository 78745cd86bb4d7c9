"""Hearing of erasures that another cloud was told: from the store that all of them share."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Final

from sqlalchemy import func, select

from cloud.chore import repeat
from cloud.store.row_digests import sound
from cloud.store.sealed import erased_subjects

if TYPE_CHECKING:
    from collections.abc import Collection
    from collections.abc import Set as AbstractSet

    from sqlalchemy import Connection

    from cloud.state import Cloud

_INTERVAL_S: Final = 1.0


def unheard(connection: Connection, known: AbstractSet[tuple[str, str]]) -> set[tuple[str, str]]:
    """Erased subjects, each with its site, that are not known; the store forgets none."""
    counted = select(func.count()).select_from(erased_subjects)
    if connection.execute(counted).scalar_one() <= len(known):
        return set()
    rows = connection.execute(select(erased_subjects)).mappings()
    found = sound(connection, erased_subjects, rows)
    return {(row["site"], row["subject"]) for row in found} - known


async def hear(cloud: Cloud, stopping: asyncio.Event) -> None:
    """Look each second until told to stop, so that a key goes where nobody asks for it, too."""
    if cloud.keyholder.vault is not None:
        work = partial(asyncio.to_thread, look, cloud)
        await repeat("erasures", work, cloud=cloud, stopping=stopping, every_s=_INTERVAL_S)


def find_erased(connection: Connection, site: str, subjects: Collection[str]) -> set[str]:
    """Which of some subjects of a site the store says were erased."""
    e = erased_subjects.c
    query = select(e.subject).where(e.site == site, e.subject.in_(sorted(subjects)))
    return set(connection.execute(query).scalars())


def look(cloud: Cloud) -> None:
    """Look once, and destroy the cloud's copies of what is erased.

    Raises:
        StoreError: The store cannot be read.
        PrivacyError: A copy cannot be destroyed.
    """
    with cloud.store.read() as connection:
        cloud.keyholder.heed(connection)
