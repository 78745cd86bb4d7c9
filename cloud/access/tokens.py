"""Bearer tokens and login codes: made, found, revoked; also while the cloud runs."""

from __future__ import annotations

import hashlib
import secrets
from typing import TYPE_CHECKING, Final

from sqlalchemy import delete, insert, or_, select, update

from cloud.access.scopes import Scope, read_scopes, write_scopes
from cloud.store.schema import login_codes, sessions, tokens

if TYPE_CHECKING:
    from collections.abc import Iterable
    from datetime import timedelta

    from sqlalchemy import Connection

    from cloud.store import Store

_BYTES: Final = 32
_PATIENCE: Final = 30.0


def digest(secret: str) -> str:
    """The name under which a secret is kept.

    Secrets are 256 random bits, so that a plain hash serves: nobody can guess them, and comparing
    hashes tells nothing of them by its time.
    """
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()


def new_secret(prefix: str) -> str:
    """A fresh secret from the operating system's generator."""
    return f"{prefix}_{secrets.token_urlsafe(_BYTES)}"


def create_token(
    store: Store, *, scopes: Iterable[Scope], name: str, lifetime: timedelta | None
) -> str:
    """Make a bearer token.

    Args:
        store: The cloud's; may be open elsewhere, too.
        scopes: What its holder may do.
        name: Whose it is, for people.
        lifetime: How long it is good; ``None`` until revoked.

    Returns:
        The token, which is told only here.

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
    store.write(lambda c: c.execute(insert(tokens), row)).result(_PATIENCE)
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

    store.write(work).result(_PATIENCE)
    return code


def revoke_token(store: Store, token: str) -> bool:
    """End a token, and the sessions that it opened; gives whether there was one.

    Raises:
        StoreError: It cannot be written.
    """
    key, now = digest(token), store.clock()

    def work(connection: Connection) -> bool:
        here = (tokens.c.digest == key) & tokens.c.revoked.is_(None)
        done = connection.execute(update(tokens).where(here).values(revoked=now)).rowcount
        connection.execute(delete(sessions).where(sessions.c.token == key))
        return done == 1

    return store.write(work).result(_PATIENCE)


def find_token(store: Store, token: str) -> frozenset[Scope] | None:
    """What a token allows; ``None`` if it is none, or no more.

    Raises:
        StoreError: The store cannot be read.
    """
    now = store.clock()
    good = or_(tokens.c.expires.is_(None), tokens.c.expires > now)
    here = (tokens.c.digest == digest(token)) & tokens.c.revoked.is_(None)
    with store.read() as connection:
        found = connection.execute(select(tokens.c.scopes).where(here, good)).scalar_one_or_none()
    return None if found is None else read_scopes(found)


def _nanoseconds(lifetime: timedelta) -> int:
    return int(lifetime.total_seconds() * 1e9)
