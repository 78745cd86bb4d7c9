"""Hearing of erasures that another cloud was told: from the store that all of them share."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Final

from sqlalchemy import func, select

from cloud.store.sealed import erased_subjects
from eskin.errors import PrivacyError, StoreError

if TYPE_CHECKING:
    from collections.abc import Set as AbstractSet

    from sqlalchemy import Connection

    from cloud.state import Cloud

log = logging.getLogger(__name__)

_INTERVAL_S: Final = 1.0


def unheard(connection: Connection, known: AbstractSet[str]) -> set[str]:
    """Erased subjects that are not among the known ones; none is ever taken from the store."""
    counted = select(func.count()).select_from(erased_subjects)
    if connection.execute(counted).scalar_one() <= len(known):
        return set()
    return set(connection.execute(select(erased_subjects.c.subject)).scalars()) - known


async def hear(cloud: Cloud, stopping: asyncio.Event) -> None:
    """Look each second until told to stop, so that a key goes where nobody asks for it, too."""
    hearing = True
    while cloud.keyholder.vault is not None and not stopping.is_set():
        try:
            await asyncio.to_thread(look, cloud)
            hearing = True
        except (StoreError, PrivacyError, OSError) as error:
            if hearing:
                log.warning("erasures are not heard of, trying again: reason=%s", error)
            hearing = False
        try:
            await asyncio.wait_for(stopping.wait(), _INTERVAL_S)
        except TimeoutError:
            continue


def look(cloud: Cloud) -> None:
    """Look once, and destroy the cloud's copies of what is erased.

    Raises:
        StoreError: The store cannot be read.
        PrivacyError: A copy cannot be destroyed.
    """
    with cloud.store.read() as connection:
        cloud.keyholder.heed(connection)
