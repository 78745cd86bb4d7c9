"""The authority's ledger: a line for each certificate that was issued, and for each revocation."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
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
    """

    serial: str
    kind: str
    name: str
    expires: str
    revoked: str | None = None
    issuer: str = ""

    def revoke(self, moment: str) -> Issued:
        """The line that revokes it.

        Args:
            moment: RFC 3339.
        """
        return replace(self, revoked=moment)


class Ledger:
    """A file that only grows.

    Args:
        path: The file, which need not be there yet.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def add(self, entry: Issued) -> None:
        """Write a line."""
        with self._path.open("a") as file:
            file.write(json.dumps(asdict(entry)) + "\n")

    def entries(self) -> list[Issued]:
        """The latest word on each certificate, in order of issue."""
        latest: dict[str, Issued] = {}
        if self._path.exists():
            for line in self._path.read_text().splitlines():
                entry = Issued(**json.loads(line))
                latest[entry.serial] = entry
        return list(latest.values())
