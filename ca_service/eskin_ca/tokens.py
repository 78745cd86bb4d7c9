"""Enrolment tokens, kept as hashes.

A token binds to the first public key that it is used for. Using it again for the same key is
allowed until it expires, so that an answer lost on the way can be asked for again. A fleet's token
is good for each of its names once, and binds each of them in the same way. Once a name was revoked,
it is enrolled by no token that was made before; the ledger's lines, not a clock, show what was.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import secrets
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

from eskin.errors import IdentityError
from eskin.identity import is_numbered, numbered
from eskin.identity.identity import write_whole
from eskin.identity.identity_kind import IdentityKind
from eskin.runtime.digest import with_check, without_check
from eskin.runtime.files.append_log import append_lines, whole_lines

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from eskin.identity.issuance_log import Revocation


class TokenUses:
    """Names of fleets that were enrolled, each with the SHA-256 of its public key.

    Args:
        path: The file, which need not be there yet.

    Raises:
        IdentityError: It cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._keys: dict[str, str] = {}
        if not path.exists():
            return
        try:
            for line in whole_lines(path.read_bytes()):
                use = without_check(json.loads(line))
                self._keys[use["name"]] = use["key"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise IdentityError(
                f"{path}: enrolled names cannot be read: {error}; bring the file back from a backup"
            ) from error

    def key(self, name: str) -> str | None:
        """The key for which a name was enrolled; ``None`` if it was not."""
        return self._keys.get(name)

    def bind(self, name: str, key: str) -> None:
        """Enrol a name for a key, durably.

        Raises:
            OSError: It cannot be written.
        """
        if self._keys.get(name) == key:
            return
        append_lines(self._path, json.dumps(with_check({"name": name, "key": key})) + "\n")
        self._keys[name] = key


TOKENS_FILE: Final = "tokens.json"


@dataclass(frozen=True, slots=True)
class Enrolment:
    """What a token stands for.

    Attributes:
        kind: Kind of the identity.
        name: Its common name; of a fleet, what all names begin with.
        hosts: A server's names and addresses.
        digest: SHA-256 of the token, hexadecimal.
        expires: RFC 3339.
        bound: SHA-256 of the public key that used it, or ``None``.
        count: Names of a fleet, NAME-0001 and so on; 0: one name.
        created: RFC 3339; empty where it was not noted yet.
        lines: How many the CA's ledger had when it was made; ``None`` where only the time was
            noted.
        site: The site of nodes and gateways; empty of other kinds.
    """

    kind: IdentityKind
    name: str
    hosts: tuple[str, ...]
    digest: str
    expires: str
    bound: str | None = None
    count: int = 0
    created: str = ""
    lines: int | None = None
    site: str = ""


class Tokens:
    """The tokens of one CA, one for each name or fleet, in one file, and their uses in another."""

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
        self._uses = TokenUses(path.with_suffix(".used"))

    def create(
        self,
        kind: IdentityKind,
        name: str,
        hosts: Sequence[str],
        lifetime: timedelta,
        *,
        lines: int,
        site: str = "",
        count: int = 0,
    ) -> str:
        """Make the token of a name, or of so many of a fleet; an older one is void.

        Args:
            kind: Kind of the identity.
            name: Its common name; of a fleet, what all names begin with.
            hosts: A server's names and addresses.
            lifetime: How long it is good.
            lines: How many the CA's ledger has: names that are revoked later are not enrolled.
            site: The site of nodes and gateways.
            count: Names of a fleet; 0: one name.
        """
        token, now = secrets.token_urlsafe(32), self._clock()
        self._enrolments[name] = Enrolment(
            kind,
            name,
            tuple(hosts),
            _digest(token.encode()),
            (now + lifetime).isoformat(),
            count=count,
            created=now.isoformat(),
            lines=lines,
            site=site,
        )
        self._write()
        return token

    def exclude(self, names: Iterable[str]) -> None:
        """Let no fleet's token enrol names that were issued a certificate without one."""
        for name in names:
            if self._uses.key(name) is None:
                self._uses.bind(name, "")

    def listed(self) -> list[tuple[Enrolment, int]]:
        """All tokens, and how often each was used."""
        return [(each, self._used(each)) for each in self._enrolments.values()]

    def judge(
        self,
        token: str,
        public_key: bytes,
        name: str = "",
        *,
        revocation: Callable[[str], Revocation | None] = lambda _: None,
    ) -> Enrolment:
        """Whether a token may be used for a public key (DER); nothing changes by it.

        Args:
            token: As its holder gives it.
            public_key: Whose request came with it.
            name: The common name that was asked for; only a fleet's token looks at it.
            revocation: When a name was revoked last; ``None`` if it never was.

        Returns:
            What is to be issued.

        Raises:
            IdentityError: It is unknown, expired, was used for another key, is not good for the
                name, or was made before the name was revoked.
        """
        enrolment, key = self._find(token), _digest(public_key)
        if self._clock() > datetime.fromisoformat(enrolment.expires):
            raise IdentityError(f"token of {enrolment.name} expired on {enrolment.expires}")
        if enrolment.count:
            _require_made_since(revocation(name), enrolment, name)
            return self._of_fleet(enrolment, name, key)
        _require_made_since(revocation(enrolment.name), enrolment, enrolment.name)
        if enrolment.bound not in {None, key}:
            raise IdentityError(f"token of {enrolment.name} was used before, for another key")
        return replace(enrolment, bound=key)

    def redeem(
        self,
        token: str,
        public_key: bytes,
        name: str = "",
        *,
        revocation: Callable[[str], Revocation | None] = lambda _: None,
    ) -> Enrolment:
        """Use a token for a public key: what `judge` gives is bound to that key.

        Raises:
            IdentityError: It may not be used.
        """
        found = self.judge(token, public_key, name, revocation=revocation)
        if self._find(token).count:
            self._uses.bind(found.name, _digest(public_key))
        else:
            self._enrolments[found.name] = found
            self._write()
        return found

    def _find(self, token: str) -> Enrolment:
        digest = _digest(token.encode())
        for enrolment in self._enrolments.values():
            if hmac.compare_digest(enrolment.digest, digest):
                return enrolment
        raise IdentityError("this enrolment token is not known; ask the CA for another")

    def _of_fleet(self, enrolment: Enrolment, name: str, key: str) -> Enrolment:
        stem, count = enrolment.name, enrolment.count
        if not is_numbered(name, stem, count):
            names = numbered(stem, count)
            raise IdentityError(
                f"token of {stem} is good for {names[0]} to {names[-1]}, not for {name[:100]!r}"
            )
        if self._uses.key(name) not in {None, key}:
            raise IdentityError(f"token of {stem} was used before for {name}, for another key")
        return replace(enrolment, name=name, bound=key, count=0)

    def _used(self, enrolment: Enrolment) -> int:
        if enrolment.count == 0:
            return int(enrolment.bound is not None)
        names = numbered(enrolment.name, enrolment.count)
        return sum(self._uses.key(name) is not None for name in names)

    def _write(self) -> None:
        entries = [with_check(asdict(enrolment)) for enrolment in self._enrolments.values()]
        write_whole(self._path, json.dumps(entries, indent=1).encode(), mode=0o600)


def _require_made_since(revoked: Revocation | None, enrolment: Enrolment, name: str) -> None:
    """Require that a token is newer than the revocation of a name."""
    if revoked is None or _is_newer(enrolment, revoked):
        return
    raise IdentityError(
        f"{name[:100]} was revoked on {revoked.instant}, and this token of {enrolment.name} was "
        "made before; ask the CA for another"
    )


def _is_newer(enrolment: Enrolment, revoked: Revocation) -> bool:
    if enrolment.lines is not None:
        return revoked.line <= enrolment.lines
    made = enrolment.created
    return bool(made) and datetime.fromisoformat(made) > revoked.instant


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _read(path: Path) -> dict[str, Enrolment]:
    if not path.exists():
        return {}
    try:
        return {
            entry["name"]: Enrolment(
                **entry | {"kind": IdentityKind(entry["kind"]), "hosts": tuple(entry["hosts"])}
            )
            for entry in map(without_check, json.loads(path.read_bytes()))
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise IdentityError(
            f"{path}: enrolment tokens cannot be read: {error!r}; bring the file back from a "
            "backup, or remove it and make new tokens"
        ) from error
