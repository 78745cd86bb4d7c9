"""The authority's ledger: a line for each certificate that was issued, and for each revocation."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from threading import Lock
from typing import TYPE_CHECKING

from eskin.errors import AuthorityError
from eskin.runtime.digest import with_check, without_check
from eskin.runtime.files.append_log import append_lines, whole_lines

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
        site: The site of a node or gateway; empty of other kinds.
    """

    serial: str
    kind: str
    name: str
    expires: str
    revoked: str | None = None
    issuer: str = ""
    key: str = ""
    site: str = ""

    def revoke(self, instant: str) -> Issued:
        """The line that revokes it.

        Args:
            instant: RFC 3339.
        """
        return replace(self, revoked=instant)


@dataclass(frozen=True, slots=True)
class Revocation:
    """When a name was revoked last.

    Attributes:
        line: The revoking line's number in the ledger, from 1: what was noted when the ledger had
            fewer lines was before, whatever the clock says.
        instant: What the clock showed.
    """

    line: int
    instant: datetime


class IssuanceLog:
    """A file that only grows; what others add to it is read when it is asked for.

    Readers get an `AuthorityError` where a line is damaged.

    Args:
        path: The file, which need not be there yet.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = Lock()
        self._start_over()

    def add(self, *entries: Issued) -> None:
        """Append lines durably; the caller holds the CA's lock.

        Raises:
            OSError: They cannot be written.
        """
        append_lines(self._path, "".join(map(_line, entries)))

    def entries(self) -> list[Issued]:
        """The latest word on each certificate, in order of issue."""
        with self._lock:
            self._follow()
            return list(self._latest.values())

    def entry(self, serial: str) -> Issued | None:
        """The latest word on a certificate; ``None`` if it is not known."""
        with self._lock:
            self._follow()
            return self._latest.get(serial)

    def length(self) -> int:
        """How many lines it has."""
        with self._lock:
            self._follow()
            return self._lines

    def is_revoked_key(self, key: str) -> bool:
        """Whether a certificate of this key was revoked."""
        with self._lock:
            self._follow()
            return key in self._revoked_keys

    def revocation(self, name: str) -> Revocation | None:
        """When a certificate of a name was revoked last; ``None`` if none ever was."""
        with self._lock:
            self._follow()
            return self._revocations.get(name)

    def site(self, name: str) -> str | None:
        """The site to which a name was issued first; ``None`` if it never was."""
        with self._lock:
            self._follow()
            return self._sites.get(name)

    def _start_over(self) -> None:
        self._read = 0
        self._lines = 0
        self._inode = 0
        self._latest: dict[str, Issued] = {}
        self._revoked_keys: set[str] = set()
        self._revocations: dict[str, Revocation] = {}
        self._sites: dict[str, str] = {}

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
        # A writer may be in the middle of a line.
        for line in whole_lines(added):
            self._take(line)

    def _take(self, line: bytes) -> None:
        number = self._lines + 1
        try:
            entry = Issued(**without_check(json.loads(line)))
            revoked = entry.revoked and datetime.fromisoformat(entry.revoked)
        except (ValueError, TypeError) as error:
            raise AuthorityError(
                f"{self._path}: line {number} is damaged: {error}; bring the file back from a "
                "backup: nothing is issued or revoked until then"
            ) from error
        self._read, self._lines = self._read + len(line), number
        self._latest[entry.serial] = entry
        self._sites.setdefault(entry.name, entry.site)
        if not revoked:
            return
        self._revocations[entry.name] = Revocation(number, revoked)
        if entry.key:
            self._revoked_keys.add(entry.key)


def _line(entry: Issued) -> str:
    return json.dumps(with_check(asdict(entry))) + "\n"
