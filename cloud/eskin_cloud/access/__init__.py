"""Who may ask: bearer tokens, one-time login codes, sessions. Secrets are kept as SHA-256 only."""

from __future__ import annotations

from eskin_cloud.access.sessions import (
    close_session,
    find_session,
    list_sessions,
    open_session,
    redeem_login_code,
    refuse_session,
    revoke_session,
)
from eskin_cloud.access.tokens import (
    Actor,
    Principal,
    Scope,
    create_login_code,
    create_token,
    digest,
    find_token,
    list_tokens,
    revoke_token,
    token_id,
)

__all__ = [
    "Actor",
    "Principal",
    "Scope",
    "close_session",
    "create_login_code",
    "create_token",
    "digest",
    "find_session",
    "find_token",
    "list_sessions",
    "list_tokens",
    "open_session",
    "redeem_login_code",
    "refuse_session",
    "revoke_session",
    "revoke_token",
    "token_id",
]
