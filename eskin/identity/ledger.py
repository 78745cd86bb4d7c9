"""The authority's ledger: a line for each certificate that was issued, and for each revocation."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Issued:
    """One line of the ledger: a certificate that was issued, or its revocation.

    Attributes:
        serial: Serial number, hexadecimal.
        kind: Kind of the identity.
        name: Common name.
        expires: RFC 3339.
        revoked: RFC 3339, or ``None``.
        issuer: Serial number of the issuing CA's certificate; empty in lines from before CAs were
            rotated.
        key: SHA-256 of the public key (see `eskin.identity.certificates.key_digest`); empty in
            lines from before revoked keys were refused.
    """

    serial: str
    kind: str
    name: str
    expires: str
    revoked: str | None = None
    issuer: str = ""
    key: str = ""

    def revoke(self, moment: str) -> Issued:
        """The line that revokes it.

        Args:
            moment: RFC 3339.
        """
        return replace(self, revoked=moment)


class Ledger:
    """A file that only grows; what others add to it is read when it is asked for.

    Args:
        path: The file, which need not be there yet.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = Lock()
        self._start_over()

    def add(self, *entries: Issued) -> None:
        """Write lines, durably."""
        lines = "".join(json.dumps(asdict(entry)) + "\n" for entry in entries)
        with self._path.open("a") as file:
            file.write(lines)
            file.flush()
            os.fsync(file.fileno())

    def entries(self) -> list[Issued]:
        """The latest word on each certificate, in order of issue."""
        with self._lock:
            self._follow()
            return list(self._latest.values())

    def is_revoked(self, serial: str) -> bool:
        """Whether a certificate was revoked."""
        with self._lock:
            self._follow()
            entry = self._latest.get(serial)
            return entry is not None and entry.revoked is not None

    def is_revoked_key(self, key: str) -> bool:
        """Whether a certificate of this key was revoked."""
        with self._lock:
            self._follow()
            return key in self._revoked_keys

    def revoked_at(self, name: str) -> datetime | None:
        """When a certificate of a name was revoked last; ``None`` if none ever was."""
        with self._lock:
            self._follow()
            return self._revoked_at.get(name)

    def _start_over(self) -> None:
        self._read = 0
        self._inode = 0
        self._latest: dict[str, Issued] = {}
        self._revoked_keys: set[str] = set()
        self._revoked_at: dict[str, datetime] = {}

    def _follow(self) -> None:
        """Read what was added: of a fleet the file is long, and each request asks for it."""
        if not self._path.exists():
            self._start_over()
            return
        with self._path.open("rb") as file:
            found = os.fstat(file.fileno())
            if found.st_ino != self._inode or found.st_size < self._read:
                self._start_over()
                self._inode = found.st_ino
            file.seek(self._read)
            added = file.read()
        # Whoever writes may be in the middle of a line.
        whole = added[: added.rfind(b"\n") + 1]
        for line in whole.splitlines():
            self._take(Issued(**json.loads(line)))
        self._read += len(whole)

    def _take(self, entry: Issued) -> None:
        self._latest[entry.serial] = entry
        if entry.revoked is None:
            return
        revoked = datetime.fromisoformat(entry.revoked)
        self._revoked_at[entry.name] = max(revoked, self._revoked_at.get(entry.name, revoked))
        if entry.key:
            self._revoked_keys.add(entry.key)
