"""The CA service as a process."""

from __future__ import annotations

import logging
import ssl
from datetime import timedelta
from typing import TYPE_CHECKING, Final

import uvicorn

from authority.application import create_application
from authority.tokens import Tokens
from eskin.identity import Authority, Identity, IdentityKind, new_key
from eskin.identity.identity import CHAIN_FILE, KEY_FILE, write_whole
from eskin.listening import Bounds, guarded

if TYPE_CHECKING:
    from authority.settings import AuthoritySettings, Expected

_MOST_BODY: Final = 65_536
_HEADERS: Final = [
    ("Cache-Control", "no-store"),
    ("Content-Security-Policy", "default-src 'none'; frame-ancestors 'none'"),
    ("Strict-Transport-Security", "max-age=31536000"),
    ("X-Content-Type-Options", "nosniff"),
]

log = logging.getLogger(__name__)


def run(settings: AuthoritySettings) -> None:
    """Serve until SIGTERM or SIGINT.

    Raises:
        IdentityError: The CA's folder cannot be read or written.
    """
    own = settings.authority
    authority = Authority.open(own.directory)
    tokens = Tokens(own.directory / "tokens.json")
    for expected in settings.identity:
        _hand_out(expected, authority, tokens, timedelta(hours=own.token_hours))
    identity = _server_identity(settings, authority)
    lifetime = timedelta(days=own.certificate_days)
    log.info("ready: https://%s:%d", own.host, own.port)
    uvicorn.run(
        create_application(
            authority, tokens, lifetime=lifetime, grace=timedelta(days=own.grace_days)
        ),
        host=own.host,
        port=own.port,
        http=guarded(Bounds(body_bytes=_MOST_BODY)),
        ws="none",
        ssl_certfile=identity.directory / CHAIN_FILE,
        ssl_keyfile=identity.directory / KEY_FILE,
        ssl_version=ssl.PROTOCOL_TLS_SERVER,
        headers=_HEADERS,
        log_config=None,
        access_log=False,
        server_header=False,
    )


def _hand_out(
    expected: Expected, authority: Authority, tokens: Tokens, lifetime: timedelta
) -> None:
    """Put token and root into the folder of an identity that was never issued a certificate."""
    write_whole(expected.directory / "root.pem", authority.root_file.read_bytes())
    if any(entry.name == expected.name for entry in authority.issued()):
        return
    token = tokens.create(expected.kind, expected.name, expected.hosts, lifetime)
    write_whole(expected.directory / f"{expected.name}.token", token.encode(), mode=0o600)
    log.info("token ready: kind=%s name=%s", expected.kind, expected.name)


def _server_identity(settings: AuthoritySettings, authority: Authority) -> Identity:
    """A fresh certificate for the service itself at each start."""
    own = settings.authority
    key = new_key()
    chain = authority.issue(
        IdentityKind.SERVER, "server.authority", key.public_key(), hosts=own.names
    )
    return Identity.save(own.directory / "server", key=key, chain=chain, root=authority.root)
