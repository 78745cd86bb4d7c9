"""The CA service as a process."""

from __future__ import annotations

import asyncio
import logging
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

import uvicorn

from eskin.errors import IdentityError, LockedError
from eskin.identity import (
    CertificateAuthority,
    Identity,
    IdentityKind,
    is_due,
    new_key,
    numbered,
    server_context,
)
from eskin.identity.ca import CA_SERVICE
from eskin.identity.identity import ROOT_FILE, write_whole
from eskin.runtime.files.lock import LockFile
from eskin.runtime.http_server.listener import Listener, bind
from eskin.runtime.http_server.protocol import BARE_HEADERS, HttpLimits
from eskin.runtime.http_server.rate_limit import LimitsMiddleware, RateLimit
from eskin_ca.app import create_application
from eskin_ca.problems import REFUSALS
from eskin_ca.tokens import TOKENS_FILE, Tokens

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from fastapi import FastAPI

    from eskin_ca.settings import CaSection, CaSettings, Expected

_MOST_BODY: Final = 65_536
_HEADERS: Final = [*BARE_HEADERS, ("Strict-Transport-Security", "max-age=31536000")]

log = logging.getLogger(__name__)


def run(settings: CaSettings) -> None:
    """Serve until SIGTERM or SIGINT.

    Raises:
        IdentityError: The CA's folder cannot be read or written, or another service has it.
        SettingsError: Its address cannot be had.
    """
    with _only_one(settings.ca.directory):
        _serve(settings)


def _serve(settings: CaSettings) -> None:
    own = settings.ca
    authority = CertificateAuthority.open(own.directory)
    tokens = Tokens(own.directory / TOKENS_FILE)
    for expected in settings.identity:
        _hand_out(expected, authority, tokens, timedelta(hours=own.token_hours))
    lifetime = timedelta(days=own.certificate_days)
    app = create_application(
        authority, tokens, lifetime=lifetime, grace=timedelta(days=own.grace_days)
    )
    app.add_middleware(
        LimitsMiddleware,
        requests=RateLimit.per_second(own.requests_per_s),
        refused=RateLimit.per_minute(own.refusals_per_min),
        statuses=REFUSALS,
    )
    enrolling = {expected.directory for expected in settings.identity}
    server = Server(app, own, authority, enrolling=enrolling)
    log.info("ready: https://%s:%d", own.host, own.port)
    server.run()


@contextmanager
def _only_one(directory: Path) -> Iterator[None]:
    """Hold the tokens for this process: another one would not know which of them are used."""
    try:
        owner = LockFile(directory / TOKENS_FILE)
    except LockedError as error:
        raise IdentityError(
            f"{directory}: another CA service runs on this folder; stop it first"
        ) from error
    except OSError as error:
        raise IdentityError(f"{directory}: cannot be written: {error.strerror}") from error
    with owner:
        yield


class Server(Listener):
    """Serves under a certificate of its own CA: a fresh one at the start, and when it is due.

    Args:
        app: What is served.
        settings: Where, and under which names.
        authority: Issues.
        enrolling: Folders of those who may enrol, which hold the roots to believe.

    Raises:
        IdentityError: The CA's folder cannot be written.
        SettingsError: The address cannot be had.
    """

    def __init__(
        self,
        app: FastAPI,
        settings: CaSection,
        authority: CertificateAuthority,
        *,
        enrolling: Iterable[Path] = (),
    ) -> None:
        self._settings = settings
        self._authority = authority
        self._enrolling = enrolling
        self._looking: asyncio.Task[None] | None = None
        self._fault = ""
        bound = bind("ca", settings.host, settings.port)
        self._identity = _server_identity(settings, authority)
        super().__init__(
            app,
            bound,
            context=server_context(self._identity.directory, client_certificates=False),
            bounds=HttpLimits(body_bytes=_MOST_BODY),
            headers=_HEADERS,
        )
        app.state.follow = self._follow

    capture_signals = uvicorn.Server.capture_signals

    async def on_tick(self, counter: int) -> bool:
        """Look after certificate and roots once a second; uvicorn calls ten times as often."""
        if counter % 10 == 0 and (self._looking is None or self._looking.done()):
            self._look_again().add_done_callback(self._tell)
        return await super().on_tick(counter)

    async def _follow(self) -> None:
        """Look, and come back once it is done; one look is enough for all who wait for it.

        Raises:
            LockedError: Another writer held the CA's lock for too long.
            IdentityError: The CA's folder cannot be read or written.
        """
        before = self._looking
        if before is not None and not before.done():
            # Its last look may be older than what the caller is about to get.
            await asyncio.wait([before])
        look = self._looking
        await asyncio.shield(self._look_again() if look is None or look is before else look)

    def _look_again(self) -> asyncio.Task[None]:
        self._looking = asyncio.create_task(asyncio.to_thread(self._look))
        return self._looking

    def _tell(self, look: asyncio.Task[None]) -> None:
        """Say why it failed, once as long as it stays the same: it is tried each second."""
        if look.cancelled():
            return
        error = look.exception()
        if error is not None and repr(error) != self._fault:
            foreseen = isinstance(error, IdentityError | LockedError | OSError)
            log.warning(
                "the CA cannot be looked after, trying again: %s",
                error,
                exc_info=None if foreseen else error,
            )
        self._fault = "" if error is None else repr(error)

    def _look(self) -> None:
        issuer = self._authority.issuer(IdentityKind.SERVER, CA_SERVICE).certificate
        due = is_due(self._identity.certificate, datetime.now(UTC))
        if due or self._identity.chain[1] != issuer:
            own = self._identity = _server_identity(self._settings, self._authority)
            log.info("renewed: name=%s until=%s", own.name, own.certificate.not_valid_after_utc)
        for folder in self._enrolling:
            _spread_roots(self._authority, folder)


def _hand_out(
    expected: Expected, authority: CertificateAuthority, tokens: Tokens, lifetime: timedelta
) -> None:
    """Put token and root into the folder of who was never issued a certificate, or not whole."""
    _spread_roots(authority, expected.directory)
    names = numbered(expected.name, expected.count) if expected.count else [expected.name]
    # First: an identity that is revoked from here on is not enrolled.
    lines = authority.register.length()
    issued = {entry.name for entry in authority.issued()}
    if issued.issuperset(names):
        return
    if expected.count:
        tokens.exclude(name for name in names if name in issued)
    given = expected.kind, expected.name, expected.hosts, lifetime
    token = tokens.create(*given, lines=lines, site=expected.site, count=expected.count)
    write_whole(expected.directory / f"{expected.name}.token", token.encode(), mode=0o600)
    log.info("token ready: kind=%s name=%s", expected.kind, expected.name)


def _spread_roots(authority: CertificateAuthority, folder: Path) -> None:
    """Give enrolling clients the present roots."""
    file, roots = folder / ROOT_FILE, authority.root_file.read_bytes()
    if not file.exists() or file.read_bytes() != roots:
        write_whole(file, roots)


def _server_identity(settings: CaSection, authority: CertificateAuthority) -> Identity:
    """A fresh certificate for the service itself."""
    key = new_key()
    chain = authority.issue(
        IdentityKind.SERVER,
        CA_SERVICE,
        key.public_key(),
        hosts=settings.names,
        lifetime=timedelta(days=settings.certificate_days),
    )
    return Identity.save(settings.directory / "server", key=key, chain=chain, roots=authority.roots)
