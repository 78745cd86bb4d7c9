"""Bearer tokens and login codes: made, found, revoked; also while the cloud runs."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from sqlalchemy import bindparam, delete, func, insert, select, update

from eskin_cloud.store.row_digests import intact_rows, require_intact_row
from eskin_cloud.store.schema.tables import login_codes, sessions, tokens
from eskin_cloud.store.write.audit_log import Action, AuditEntry, record

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from datetime import timedelta

    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.store import Store

_BYTES: Final = 32
COMMAND_LINE: Final = "command line"
"""Who does what is done with the store in hand."""
_TOKEN: Final = select(tokens).where(tokens.c.digest == bindparam("digest"))


class Scope(StrEnum):
    """What its holder may do."""

    READ = "read"
    OPERATE = "operate"
    ADMIN = "admin"
    BIOMETRIC = "biometric"


def write_scopes(scopes: Iterable[Scope]) -> str:
    """Write scopes as the store keeps them."""
    return " ".join(sorted(set(scopes)))


def read_scopes(text: str) -> frozenset[Scope]:
    """Read scopes as the store keeps them."""
    return frozenset(Scope(word) for word in text.split())


@dataclass(frozen=True, slots=True)
class Principal:
    """Who holds a secret.

    Attributes:
        name: For people: the token's name, or ``login link``.
        scopes: What they may do.
    """

    name: str
    scopes: frozenset[Scope]


@dataclass(frozen=True, slots=True)
class Actor:
    """Who does something to tokens, for the audit log.

    Attributes:
        name: A holder's, or the command line.
        address: From where; empty on this machine's command line.
    """

    name: str = COMMAND_LINE
    address: str = ""


def digest(secret: str) -> str:
    """The name under which a secret is kept.

    Secrets are 256 random bits, so that a plain hash serves: they cannot be guessed, and comparing
    hashes discloses nothing of them by its time.
    """
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()


def new_secret(prefix: str) -> str:
    """A fresh secret from the operating system's generator."""
    return f"{prefix}_{secrets.token_urlsafe(_BYTES)}"


def create_token(
    store: Store,
    *,
    scopes: Iterable[Scope],
    name: str,
    lifetime: timedelta | None,
    actor: Actor | None = None,
) -> str:
    """Make a bearer token.

    Args:
        store: The cloud's; may be open elsewhere, too.
        scopes: What its holder may do.
        name: Whose it is, for people.
        lifetime: How long it is good; ``None`` until revoked.
        actor: Who makes it; ``None``: the command line.

    Returns:
        The token, which is returned only here.

    Raises:
        StoreError: It cannot be written.
    """
    token, now = new_secret("eskin"), store.clock()
    row = {
        "digest": digest(token),
        "name": name[:100],
        "scopes": write_scopes(scopes),
        "created": now,
        "expires": None if lifetime is None else now + _nanoseconds(lifetime),
    }
    detail = f"{row['name']}: {row['scopes']}"

    def work(connection: Connection) -> None:
        connection.execute(insert(tokens), row)
        audit_entry = _audit_entry(
            actor, Action.TOKEN_CREATED, token_id(str(row["digest"])), detail
        )
        record(connection, audit_entry, now=now)

    store.write_and_wait(work)
    return token


def create_login_code(
    store: Store, *, lifetime: timedelta, scopes: Iterable[Scope] = (Scope.READ,)
) -> str:
    """Make a code that opens one session, once: ``/login?code=…``.

    Raises:
        StoreError: It cannot be written.
    """
    code, now = new_secret("login"), store.clock()
    row = {
        "digest": digest(code),
        "scopes": write_scopes(scopes),
        "expires": now + _nanoseconds(lifetime),
    }

    def work(connection: Connection) -> None:
        connection.execute(delete(login_codes).where(login_codes.c.expires <= now))
        connection.execute(insert(login_codes), row)
        record(connection, _audit_entry(None, Action.LOGIN_LINK, "", str(row["scopes"])), now=now)

    store.write_and_wait(work)
    return code


def token_id(key: str) -> str:
    """The id of a token, which is no secret: the first half of its digest."""
    return key[:32]


def list_tokens(connection: Connection) -> Sequence[RowMapping]:
    """All tokens that were ever made, the latest first."""
    query = select(tokens).order_by(tokens.c.created.desc(), tokens.c.digest)
    return intact_rows(connection, tokens, connection.execute(query).mappings())


def revoke_token(store: Store, number: str, *, actor: Actor | None = None) -> bool:
    """End a token, and the sessions that it opened.

    Args:
        store: The cloud's; may be open elsewhere, too.
        number: The token's id.
        actor: Who ends it; ``None``: the command line.

    Returns:
        Whether there was one that was not revoked yet.

    Raises:
        StoreError: It cannot be written.
    """
    now = store.clock()

    def work(connection: Connection) -> bool:
        query = select(tokens.c.digest, tokens.c.name).where(
            func.substr(tokens.c.digest, 1, len(token_id("0" * 64))) == number,
            tokens.c.revoked.is_(None),
        )
        found = connection.execute(query).one_or_none()
        if found is None:
            return False
        here = tokens.c.digest == found[0]
        connection.execute(update(tokens).where(here).values(revoked=now))
        connection.execute(delete(sessions).where(sessions.c.token == found[0]))
        record(connection, _audit_entry(actor, Action.TOKEN_REVOKED, number, found[1]), now=now)
        return True

    return store.write_and_wait(work)


def find_token(store: Store, token: str) -> Principal | None:
    """Who holds a token; ``None`` if it is none, or no more.

    Raises:
        StoreError: The store cannot be read.
    """
    with store.read() as connection:
        row = good_token(connection, digest(token), now=store.clock())
    return None if row is None else Principal(row["name"], read_scopes(row["scopes"]))


def good_token(connection: Connection, key: str, *, now: int) -> RowMapping | None:
    """A token's row by its digest; ``None`` if it is none, or no more.

    Raises:
        DamagedRowError: It is not as it was written.
    """
    row = connection.execute(_TOKEN, {"digest": key}).mappings().one_or_none()
    row = require_intact_row(connection, tokens, row)
    if row is None or row["revoked"] is not None:
        return None
    return row if row["expires"] is None or row["expires"] > now else None


def _audit_entry(actor: Actor | None, action: Action, target: str, detail: str) -> AuditEntry:
    by = actor or Actor()
    return AuditEntry(by.name, by.address, action, target, detail)


def _nanoseconds(lifetime: timedelta) -> int:
    return int(lifetime.total_seconds() * 1e9)
