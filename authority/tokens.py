"""One-time enrolment tokens, kept as hashes.

A token binds to the first public key that it is used for. Using it again for the same key is
allowed until it expires, so that an answer lost on the way can be asked for again.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import secrets
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from eskin.errors import IdentityError
from eskin.identity.identity import write_whole
from eskin.identity.kinds import IdentityKind

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Enrolment:
    """What a token stands for.

    Attributes:
        kind: Kind of the identity.
        name: Its common name.
        hosts: A server's names and addresses.
        digest: SHA-256 of the token, hexadecimal.
        expires: RFC 3339.
        bound: SHA-256 of the public key that used it, or ``None``.
    """

    kind: IdentityKind
    name: str
    hosts: tuple[str, ...]
    digest: str
    expires: str
    bound: str | None = None


class Tokens:
    """The tokens of one CA, one for each name, in one file."""

    def __init__(
        self, path: Path, *, clock: Callable[[], datetime] = lambda: datetime.now(UTC)
    ) -> None:
        """Open the file, which need not be there yet.

        Raises:
            IdentityError: It cannot be read.
        """
        self._path = path
        self._clock = clock
        self._enrolments = _read(path)

    def create(
        self, kind: IdentityKind, name: str, hosts: Sequence[str], lifetime: timedelta
    ) -> str:
        """Make the token of a name; an older one is void."""
        token = secrets.token_urlsafe(32)
        expires = (self._clock() + lifetime).isoformat()
        self._enrolments[name] = Enrolment(kind, name, tuple(hosts), _digest(token), expires)
        self._write()
        return token

    def redeem(self, token: str, public_key: bytes) -> Enrolment:
        """Use a token for a public key (DER).

        Raises:
            IdentityError: It is unknown, expired, or was used for another key.
        """
        digest, key = _digest(token), hashlib.sha256(public_key).hexdigest()
        for enrolment in self._enrolments.values():
            if hmac.compare_digest(enrolment.digest, digest):
                break
        else:
            raise IdentityError("this enrolment token is not known; ask the CA for another")
        if self._clock() > datetime.fromisoformat(enrolment.expires):
            raise IdentityError(f"token of {enrolment.name} expired on {enrolment.expires}")
        if enrolment.bound not in {None, key}:
            raise IdentityError(f"token of {enrolment.name} was used before, for another key")
        bound = replace(enrolment, bound=key)
        self._enrolments[enrolment.name] = bound
        self._write()
        return bound

    def _write(self) -> None:
        entries = [asdict(enrolment) for enrolment in self._enrolments.values()]
        write_whole(self._path, json.dumps(entries, indent=1).encode(), mode=0o600)


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()


def _read(path: Path) -> dict[str, Enrolment]:
    if not path.exists():
        return {}
    try:
        entries = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise IdentityError(f"{path}: enrolment tokens cannot be read: {error}") from error
    return {
        entry["name"]: Enrolment(
            **entry | {"kind": IdentityKind(entry["kind"]), "hosts": tuple(entry["hosts"])}
        )
        for entry in entries
    }
