"""Sessions of browsers, opened by a one-time code or by a token."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sqlalchemy import delete, insert, or_, select

from cloud.access.scopes import Scope, read_scopes, write_scopes
from cloud.access.tokens import digest, find_token, new_secret
from cloud.store.schema import login_codes, sessions, tokens

if TYPE_CHECKING:
    from concurrent.futures import Future

    from sqlalchemy import Connection

    from cloud.store import Store


@dataclass(frozen=True, slots=True)
class Grant:
    """What opens a session.

    Attributes:
        scopes: What the session allows.
        token: Digest of the token that it hangs on; ``None`` if it hangs on none.
        expires: UTC ns.
    """

    scopes: frozenset[Scope]
    token: str | None
    expires: int


def redeem_login_code(store: Store, code: str, *, lifetime: int) -> Future[str | None]:
    """Use up a code; the session's secret, or ``None`` if the code is none, or no more.

    Args:
        store: The cloud's.
        code: As it came.
        lifetime: Of the session, in ns.

    Raises:
        StoreError: Too many writes wait.
    """
    now = store.clock()

    def work(connection: Connection) -> str | None:
        here = login_codes.c.digest == digest(code)
        row = connection.execute(select(login_codes).where(here)).mappings().one_or_none()
        # Taken by whoever deletes it: two that come at once cannot both have it.
        if row is None or connection.execute(delete(login_codes).where(here)).rowcount != 1:
            return None
        if row["expires"] <= now:
            return None
        grant = Grant(read_scopes(row["scopes"]), None, now + lifetime)
        return _insert(connection, grant, now)

    return store.write(work)


def open_session(store: Store, token: str, *, lifetime: int) -> Future[str] | None:
    """Open a session for the holder of a token; ``None`` if the token is none.

    Raises:
        StoreError: The store cannot be read, or too many writes wait.
    """
    scopes = find_token(store, token)
    if scopes is None:
        return None
    now = store.clock()
    grant = Grant(scopes, digest(token), now + lifetime)
    return store.write(lambda connection: _insert(connection, grant, now))


def find_session(store: Store, secret: str) -> frozenset[Scope] | None:
    """What a session allows; ``None`` if it is none, or its token is good no more.

    Raises:
        StoreError: The store cannot be read.
    """
    now = store.clock()
    query = (
        select(sessions.c.scopes)
        .outerjoin(tokens, tokens.c.digest == sessions.c.token)
        .where(sessions.c.digest == digest(secret), sessions.c.expires > now)
        .where(tokens.c.revoked.is_(None))
        .where(or_(tokens.c.expires.is_(None), tokens.c.expires > now))
    )
    with store.read() as connection:
        found = connection.execute(query).scalar_one_or_none()
    return None if found is None else read_scopes(found)


def close_session(store: Store, secret: str) -> Future[None]:
    """End a session.

    Raises:
        StoreError: Too many writes wait.
    """

    def work(connection: Connection) -> None:
        connection.execute(delete(sessions).where(sessions.c.digest == digest(secret)))

    return store.write(work)


def _insert(connection: Connection, grant: Grant, now: int) -> str:
    secret = new_secret("session")
    connection.execute(delete(sessions).where(sessions.c.expires <= now))
    row = {
        "digest": digest(secret),
        "scopes": write_scopes(grant.scopes),
        "token": grant.token,
        "expires": grant.expires,
    }
    connection.execute(insert(sessions), row)
    return secret
