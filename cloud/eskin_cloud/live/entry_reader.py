"""Entries of the feed as one caller may read them."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING

from eskin.errors import BrokenSealError, MessageError, NoKeyError, PrivacyError
from eskin.privacy import SealedMessage
from eskin.wire.frames import EncodedFrame
from eskin_cloud.privacy.sealed_rows import event_rows

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from eskin.privacy.cipher import Sealable
    from eskin_cloud.access import Scope
    from eskin_cloud.live.layouts import Layouts
    from eskin_cloud.privacy.key_access import KeyAccess
    from eskin_cloud.store import Store
    from eskin_cloud.store.feed_entry import FeedEntry

log = logging.getLogger(__name__)


class EntryReader:
    """Reads the live feed's entries for one caller.

    Args:
        key_access: Opens what is sealed.
        scopes: The caller's.
        layouts: Those of the entries.
        store: Holds the sites of nodes.
    """

    def __init__(
        self, key_access: KeyAccess, scopes: Iterable[Scope], layouts: Layouts, store: Store
    ) -> None:
        self._key_access = key_access
        self._shown = key_access.may(scopes)
        self._layouts = layouts
        self._store = store
        self._keyless: set[tuple[str, str]] = set()
        self._unreadable: set[tuple[str, str]] = set()
        self._left_out = False

    async def load(self, entries: Sequence[FeedEntry]) -> None:
        """Load what reading them needs: their layouts, and the sites of nodes that are new here.

        Raises:
            StoreError: The store cannot be read.
        """
        await self._layouts.load(entries)
        sealed = {entry.node for entry in entries if entry.sealed is not None}
        if self._shown and self._lacks_sites(sealed):
            await asyncio.to_thread(self._load_sites, sealed)

    def _lacks_sites(self, nodes: Iterable[str]) -> bool:
        return not all(map(self._key_access.site_of, nodes))

    def _load_sites(self, nodes: Iterable[str]) -> None:
        if self._lacks_sites(nodes):  # else another stream has loaded them meanwhile
            with self._store.read() as connection:
                self._key_access.apply_erasures(connection)

    def left_out(self) -> bool:
        """Whether `read` has left something out that the caller can ask for by now, or later.

        It is so when a key cannot be read at present, when it can be again, and when a key has come
        that was missing. Where it never comes, as a site keeps its keys, nothing can be asked for.
        Each is stated once.
        """
        left_out, self._left_out = self._left_out, False
        return left_out

    def read(self, entry: FeedEntry) -> Sequence[FeedEntry]:
        """What an entry looks like to the caller; statements give an entry for each event.

        It is empty for what the caller may not read, and for what cannot be read.

        Raises:
            StoreError: Erasures were not looked for in a while.
        """
        if entry.sealed is None:
            return [entry]
        if not self._shown:
            return []
        self._key_access.require_fresh_erasures()
        opened = self._open(entry.node, entry.sealed)
        if opened is None:
            return []
        message, data = opened
        if isinstance(message, EncodedFrame):
            return [entry._replace(frame=data, sealed=None, secret=True)]
        described = self._layouts.get(entry.layout)
        rows = event_rows(entry.node, message, data, described, entry.cursor)
        return [
            entry._replace(channel=row["channel"], event=row, sealed=None, layout=None)
            for row in rows
        ]

    def _open(self, node: str, data: bytes) -> tuple[Sealable, bytes] | None:
        try:
            sealed = SealedMessage.decode(data)
        except MessageError:  # damaged
            return None
        subject = self._key_access.site_of(node), sealed.subject
        try:
            opened = self._key_access.read(node, sealed)
        except BrokenSealError:  # damaged
            return None
        except NoKeyError as error:
            if not error.erased:
                self._keyless.add(subject)
            return None
        except PrivacyError as error:  # such as a token that was unplugged
            if subject not in self._unreadable:
                log.warning("live stream leaves out what is encrypted: reason=%s", error)
                self._unreadable.add(subject)
                self._left_out = True
            return None
        if subject in self._keyless | self._unreadable:
            self._keyless.discard(subject)
            self._unreadable.discard(subject)
            self._left_out = True
        return opened
