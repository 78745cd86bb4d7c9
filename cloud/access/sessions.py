"""Sessions of browsers, opened by a one-time code or by a token."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sqlalchemy import delete, func, insert, or_, select

from cloud.access.scopes import read_scopes, write_scopes
from cloud.access.tokens import Doer, Holder, digest, find_token, new_secret, token_id
from cloud.store.audit_log import Action, Deed, record
from cloud.store.schema import login_codes, sessions, tokens

if TYPE_CHECKING:
    from collections.abc import Sequence
    from concurrent.futures import Future

    from sqlalchemy import Connection, RowMapping

    from cloud.store import Store


LOGIN_LINK: Final = "login link"
"""Who holds a session that no token opened."""


@dataclass(frozen=True, slots=True)
class Grant:
    """What opens a session.

    Attributes:
        holder: Who has the session.
        address: From where it was opened.
        token: Digest of the token that it hangs on; ``None`` if it hangs on none.
        expires: UTC ns.
    """

    holder: Holder
    address: str
    token: str | None
    expires: int


def redeem_login_code(
    store: Store, code: str, *, lifetime: int, address: str
) -> Future[str | None]:
    """Use up a code; the session's secret, or ``None`` if the code is none, or no more.

    Args:
        store: The cloud's.
        code: As it came.
        lifetime: Of the session, in ns.
        address: From where it came.

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
        holder = Holder(LOGIN_LINK, read_scopes(row["scopes"]))
        grant = Grant(holder, address, None, now + lifetime)
        return _insert(connection, grant, now)

    return store.write(work)


def open_session(store: Store, token: str, *, lifetime: int, address: str) -> Future[str] | None:
    """Open a session for the holder of a token; ``None`` if the token is none.

    Raises:
        StoreError: The store cannot be read, or too many writes wait.
    """
    holder = find_token(store, token)
    if holder is None:
        return None
    now = store.clock()
    grant = Grant(holder, address, digest(token), now + lifetime)
    return store.write(lambda connection: _insert(connection, grant, now))


def find_session(store: Store, secret: str) -> Holder | None:
    """Who holds a session; ``None`` if it is none, or its token is good no more.

    Raises:
        StoreError: The store cannot be read.
    """
    now = store.clock()
    query = (
        select(sessions.c.scopes, tokens.c.name)
        .outerjoin(tokens, tokens.c.digest == sessions.c.token)
        .where(sessions.c.digest == digest(secret), sessions.c.expires > now)
        .where(tokens.c.revoked.is_(None))
        .where(or_(tokens.c.expires.is_(None), tokens.c.expires > now))
    )
    with store.read() as connection:
        found = connection.execute(query).one_or_none()
    return None if found is None else Holder(found[1] or LOGIN_LINK, read_scopes(found[0]))


def close_session(store: Store, secret: str, *, address: str) -> Future[None]:
    """End a session.

    Raises:
        StoreError: Too many writes wait.
    """
    now, here = store.clock(), sessions.c.digest == digest(secret)

    def work(connection: Connection) -> None:
        query = select(tokens.c.name).select_from(sessions)
        query = query.outerjoin(tokens, tokens.c.digest == sessions.c.token).where(here)
        found = connection.execute(query).one_or_none()
        if found is not None:
            connection.execute(delete(sessions).where(here))
            deed = Deed(found[0] or LOGIN_LINK, address, Action.SIGN_OUT)
            record(connection, deed, now=now)

    return store.write(work)


def list_sessions(connection: Connection, *, now: int) -> Sequence[RowMapping]:
    """Sessions that are good: ``id``, ``name``, ``scopes`` and ``expires``, the latest last."""
    c = sessions.c
    query = (
        select(
            func.substr(c.digest, 1, len(token_id("0" * 64))).label("id"),
            func.coalesce(tokens.c.name, LOGIN_LINK).label("name"),
            c.scopes,
            c.expires,
        )
        .outerjoin(tokens, tokens.c.digest == c.token)
        .where(c.expires > now)
        .order_by(c.expires, c.digest)
    )
    return connection.execute(query).mappings().all()


def revoke_session(store: Store, number: str, *, doer: Doer | None = None) -> bool:
    """End a session, whatever opened it; its open requests and streams end, too.

    Args:
        store: The cloud's; may be open elsewhere, too.
        number: The session's id.
        doer: Who ends it; ``None``: the command line.

    Returns:
        Whether there was one.

    Raises:
        StoreError: It cannot be written.
    """
    now, by = store.clock(), doer or Doer()
    here = func.substr(sessions.c.digest, 1, len(token_id("0" * 64))) == number

    def work(connection: Connection) -> bool:
        if not connection.execute(delete(sessions).where(here)).rowcount:
            return False
        deed = Deed(by.name, by.address, Action.SESSION_REVOKED, number)
        record(connection, deed, now=now)
        return True

    return store.finish(work)


def refuse_session(store: Store, *, address: str) -> Future[None]:
    """Keep that somebody was not let in.

    Raises:
        StoreError: Too many writes wait.
    """
    deed, now = Deed("", address, Action.SIGN_IN_REFUSED), store.clock()
    return store.write(lambda connection: record(connection, deed, now=now))


def _insert(connection: Connection, grant: Grant, now: int) -> str:
    secret = new_secret("session")
    connection.execute(delete(sessions).where(sessions.c.expires <= now))
    row = {
        "digest": digest(secret),
        "scopes": write_scopes(grant.holder.scopes),
        "token": grant.token,
        "expires": grant.expires,
    }
    connection.execute(insert(sessions), row)
    deed = Deed(grant.holder.name, grant.address, Action.SIGN_IN, "", str(row["scopes"]))
    record(connection, deed, now=now)
    return secret
