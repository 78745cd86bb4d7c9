"""Layouts of the frames that streams send."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Final

from cachetools import LRUCache

from eskin.errors import MessageError
from eskin_cloud.store.descriptions import UnknownDescriptionError, find_layout

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eskin.wire.frames import DescribedLayout
    from eskin_cloud.store import Store
    from eskin_cloud.store.feed_entry import FeedEntry

log = logging.getLogger(__name__)

_KEPT: Final = 1024


class Layouts:
    """Layouts by hash, read in a thread; on the event loop only.

    Args:
        store: Holds them.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._kept: LRUCache[bytes, DescribedLayout | None] = LRUCache(_KEPT)

    def get(self, name: bytes | None) -> DescribedLayout | None:
        """A layout that was loaded; ``None`` if the store has no intact one."""
        return None if name is None else self._kept.get(name)

    async def load(self, entries: Iterable[FeedEntry]) -> None:
        """Load the layouts of frames; what the store has no intact one of is not sought again.

        Raises:
            StoreError: The store cannot be read.
        """
        for entry in entries:
            if entry.layout is not None and entry.layout not in self._kept:
                node, name = entry.node, entry.layout
                self._kept[name] = await asyncio.to_thread(self._find, node, name)

    def _find(self, node: str, name: bytes) -> DescribedLayout | None:
        try:
            with self._store.read() as connection:
                return find_layout(connection, node, name)
        except (UnknownDescriptionError, MessageError) as error:
            log.warning("layout of a frame is missing: node=%s reason=%s", node, error)
            return None
