"""A party's side of the CA service while it runs: renews in time, and brings what the CA says."""

from __future__ import annotations

import logging
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from threading import Event, Thread
from typing import TYPE_CHECKING, Final, Self

from eskin.errors import LockedError
from eskin.identity import (
    Identity,
    common_name,
    finish_renewal,
    forget_past,
    is_due,
    is_superseded,
    load_certificates,
)
from eskin.runtime.files.lock import LockFile
from eskin.runtime.supervised import FaultLog
from eskin_ca.client import fetch_revocations, fetch_roots, fetch_site, renew

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from eskin.identity import IdentityKind
    from eskin.runtime.settings import RenewalSection

log = logging.getLogger(__name__)

_RENEWAL: Final = "renewal"
"""The agent that renews an identity locks this file of its folder."""


class RenewalAgent:
    """Works in a thread while its block runs; without a CA service, not at all.

    The services watch their own files, so any process may renew them.

    Args:
        settings: The CA service.
        identities: Folders to renew, each with the roots that it trusts; of the rest the first
            one's are believed.
        site: File of the site's certificate, for a node.
        lists: Files of revocation lists; ``None`` where a process has none.

    Attributes:
        fault_log: Logs what fails.
    """

    def __init__(
        self,
        settings: RenewalSection,
        identities: Sequence[Path],
        *,
        site: Path | None = None,
        lists: Mapping[IdentityKind, Path | None] | None = None,
    ) -> None:
        self._url = settings.url
        self._every = settings.every_s
        self._identities = identities
        self._site = site
        self._lists = {kind: path for kind, path in (lists or {}).items() if path is not None}
        self.fault_log = FaultLog()
        self._stopping = Event()
        self._thread = Thread(target=self._run, name="keeper", daemon=True)

    def __enter__(self) -> Self:
        if self._url:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        if self._url:
            self._thread.join()

    def look(self) -> None:
        """Do what is due, once; what fails is logged once, and tried again at the next look."""
        self.fault_log.attempt("roots", self._follow_roots)
        for directory in self._identities:
            self.fault_log.attempt(f"renew {directory.name}", partial(self._renew, directory))
        root = self._identities[0]
        if self._site is not None:
            self.fault_log.attempt("site", partial(self._follow_site, root, self._site))
        for kind, path in self._lists.items():
            fetch = partial(fetch_revocations, self._url, root, kind, path)
            self.fault_log.attempt(f"revocations of {kind}s", fetch)

    def _run(self) -> None:
        while not self._stopping.is_set():
            self.look()
            self._stopping.wait(self._every)

    def _renew(self, directory: Path) -> None:
        """Renew what is due; where gateways share a site's folder, one of them does it."""
        with suppress(LockedError), LockFile(directory / _RENEWAL):
            finish_renewal(directory)
            now = datetime.now(UTC)
            forget_past(directory, now)
            standing = Identity.load(directory)
            if is_due(standing.certificate, now) or is_superseded(standing):
                own = renew(self._url, directory)
                log.info("renewed: name=%s until=%s", own.name, own.certificate.not_valid_after_utc)

    def _follow_roots(self) -> None:
        for directory in fetch_roots(self._url, *self._identities):
            log.info("roots replaced: of=%s", directory.name)

    def _follow_site(self, directory: Path, site: Path) -> None:
        name = common_name(load_certificates(site)[0])
        if fetch_site(self._url, directory, name, site):
            log.info("site's certificate renewed: name=%s", name)
