"""Who may ask: bearer tokens, one-time login codes, sessions. Secrets are kept as SHA-256 only."""

from __future__ import annotations

from cloud.access.scopes import Scope
from cloud.access.sessions import close_session, find_session, open_session, redeem_login_code
from cloud.access.tokens import create_login_code, create_token, find_token, revoke_token

__all__ = [
    "Scope",
    "close_session",
    "create_login_code",
    "create_token",
    "find_session",
    "find_token",
    "open_session",
    "redeem_login_code",
    "revoke_token",
]
