"""Sessions of browsers, opened by a one-time code or by a token."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import bindparam, delete, func, insert, select

from eskin_cloud.access.tokens import (
    Actor,
    Principal,
    digest,
    find_token,
    good_token,
    list_tokens,
    new_secret,
    read_scopes,
    token_id,
    write_scopes,
)
from eskin_cloud.store.row_digests import intact_rows, require_intact_row
from eskin_cloud.store.schema.tables import login_codes, sessions, tokens
from eskin_cloud.store.write.audit_log import Action, AuditEntry, record

if TYPE_CHECKING:
    from concurrent.futures import Future

    from sqlalchemy import Connection

    from eskin_cloud.store import Store


LOGIN_LINK: Final = "login link"
"""Who holds a session that no token opened."""
_SESSION: Final = select(sessions).where(sessions.c.digest == bindparam("digest"))


@dataclass(frozen=True, slots=True)
class Grant:
    """What opens a session.

    Attributes:
        holder: Who has the session.
        address: From where it was opened.
        token: Digest of the token that it hangs on; ``None`` if it hangs on none.
        expires: UTC ns.
    """

    holder: Principal
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
        row = require_intact_row(connection, login_codes, row)
        # The request that deletes it has it: of two at once, one gets a session.
        if row is None or connection.execute(delete(login_codes).where(here)).rowcount != 1:
            return None
        if row["expires"] <= now:
            return None
        holder = Principal(LOGIN_LINK, read_scopes(row["scopes"]))
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


def find_session(store: Store, secret: str) -> Principal | None:
    """A session's principal; ``None`` if it is unknown, or its token is not valid.

    Raises:
        StoreError: The store cannot be read.
    """
    now = store.clock()
    with store.read() as connection:
        row = connection.execute(_SESSION, {"digest": digest(secret)}).mappings().one_or_none()
        row = require_intact_row(connection, sessions, row)
        if row is None or row["expires"] <= now:
            return None
        if row["token"] is None:
            return Principal(LOGIN_LINK, read_scopes(row["scopes"]))
        token = good_token(connection, row["token"], now=now)
    return None if token is None else Principal(token["name"], read_scopes(row["scopes"]))


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
            audit_entry = AuditEntry(found[0] or LOGIN_LINK, address, Action.SIGN_OUT)
            record(connection, audit_entry, now=now)

    return store.write(work)


def list_sessions(connection: Connection, *, now: int) -> list[dict[str, Any]]:
    """Sessions that are good: ``id``, ``name``, ``scopes`` and ``expires``, the latest last."""
    c = sessions.c
    rows = connection.execute(select(sessions).order_by(c.expires, c.digest)).mappings()
    names = {row["digest"]: row["name"] for row in list_tokens(connection)}
    good = [
        row
        for row in intact_rows(connection, sessions, rows)
        if row["expires"] > now and (row["token"] is None or row["token"] in names)
    ]
    return [
        {
            "id": token_id(row["digest"]),
            "name": LOGIN_LINK if row["token"] is None else names[row["token"]],
            "scopes": row["scopes"],
            "expires": row["expires"],
        }
        for row in good
    ]


def revoke_session(store: Store, number: str, *, actor: Actor | None = None) -> bool:
    """End a session, whatever opened it; its open requests and streams end, too.

    Args:
        store: The cloud's; may be open elsewhere, too.
        number: The session's id.
        actor: Who ends it; ``None``: the command line.

    Returns:
        Whether there was one.

    Raises:
        StoreError: It cannot be written.
    """
    now, by = store.clock(), actor or Actor()
    here = func.substr(sessions.c.digest, 1, len(token_id("0" * 64))) == number

    def work(connection: Connection) -> bool:
        if not connection.execute(delete(sessions).where(here)).rowcount:
            return False
        audit_entry = AuditEntry(by.name, by.address, Action.SESSION_REVOKED, number)
        record(connection, audit_entry, now=now)
        return True

    return store.write_and_wait(work)


def refuse_session(store: Store, *, address: str) -> Future[None]:
    """Audit a refused sign-in.

    Raises:
        StoreError: Too many writes wait.
    """
    audit_entry, now = AuditEntry("", address, Action.SIGN_IN_REFUSED), store.clock()
    return store.write(lambda connection: record(connection, audit_entry, now=now))


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
    audit_entry = AuditEntry(
        grant.holder.name, grant.address, Action.SIGN_IN, "", str(row["scopes"])
    )
    record(connection, audit_entry, now=now)
    return secret
