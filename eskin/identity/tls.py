"""TLS contexts: version 1.2 at least, both sides always checked, no way to turn it off.

A context follows its files: a renewed identity, or other roots, count from the next handshake on.
"""

from __future__ import annotations

import logging
import ssl
from typing import TYPE_CHECKING, Any, Self

from eskin.errors import IdentityError
from eskin.identity.identity import CHAIN_FILE, KEY_FILE, NEXT, ROOT_FILE
from eskin.runtime.files.stamp import Version, version

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from eskin.identity.identity import Identity

log = logging.getLogger(__name__)


class ClosingSocket(ssl.SSLSocket):
    """Closes itself when its handshake fails; paho leaves the socket open."""

    def do_handshake(self, block: bool = False) -> None:  # noqa: FBT001, FBT002 - as it is
        """See `ssl.SSLSocket`."""
        try:
            super().do_handshake(block)
        except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
            raise
        except (OSError, ValueError):
            self.close()
            raise


class FollowingContext(ssl.SSLContext):
    """Makes connections by another context as soon as one of its files was replaced.

    OpenSSL can add a root to a context, and take none away. Where a file cannot be used, as in the
    middle of a renewal, the context before goes on.
    """

    sslsocket_class = ClosingSocket
    _files: Sequence[Path]
    _set_up: Callable[[ssl.SSLContext], None]
    # None while this context itself holds what the files say, as for most of those of a fleet.
    _newest: ssl.SSLContext | None = None
    _seen: tuple[Version, ...] | None
    _protocols: Sequence[str] = ()
    _fault = ""

    @classmethod
    def over(
        cls, protocol: int, files: Sequence[Path], set_up: Callable[[ssl.SSLContext], None]
    ) -> Self:
        """Follow files.

        Args:
            protocol: As `ssl.SSLContext` takes it.
            files: Which.
            set_up: Has a fresh context use them, or raises `IdentityError`.

        Raises:
            IdentityError: They cannot be used now.
        """
        own = cls(protocol)
        own._files, own._set_up, own._seen = files, set_up, _versions(files)
        set_up(own)
        return own

    def wrap_socket(self, *given: Any, **named: Any) -> ssl.SSLSocket:
        """See `ssl.SSLContext`."""
        newest = self._follow()
        if newest is None:
            return super().wrap_socket(*given, **named)
        return newest.wrap_socket(*given, **named)

    def wrap_bio(self, *given: Any, **named: Any) -> ssl.SSLObject:
        """See `ssl.SSLContext`."""
        newest = self._follow()
        if newest is None:
            return super().wrap_bio(*given, **named)
        return newest.wrap_bio(*given, **named)

    def set_alpn_protocols(self, alpn_protocols: Any) -> None:
        """See `ssl.SSLContext`."""
        self._protocols = alpn_protocols
        super().set_alpn_protocols(alpn_protocols)

    def _follow(self) -> ssl.SSLContext | None:
        try:
            seen = _versions(self._files)
            if seen is None or seen != self._seen:
                fresh = ssl.SSLContext(self.protocol)
                self._set_up(fresh)
                self._newest, self._seen, self._fault = fresh, seen, ""
        except IdentityError as error:
            if str(error) != self._fault:  # clients decide how often it is looked at
                log.warning("a TLS identity cannot be read, the one before goes on: %s", error)
            self._fault = str(error)
        newest = self._newest
        if newest is not None:
            newest.sslsocket_class = self.sslsocket_class
            if self._protocols:
                newest.set_alpn_protocols(self._protocols)
        return newest


def client_context(root_file: Path, identity: Identity | None = None) -> ssl.SSLContext:
    """A client's side: the server must lead to a root and have the host's name.

    Args:
        root_file: PEM of the root CAs.
        identity: Shown to a server that asks; must be on disk.

    Raises:
        IdentityError: A file cannot be read.
    """
    folder = None if identity is None else identity.directory

    def set_up(context: ssl.SSLContext) -> None:
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        _trust(context, root_file)
        if folder is not None:
            show(context, folder)

    files = [root_file, *_files(folder)]
    return FollowingContext.over(ssl.PROTOCOL_TLS_CLIENT, files, set_up)


def server_context(folder: Path, *, client_certificates: bool) -> ssl.SSLContext:
    """A server's side.

    Args:
        folder: With ``chain.pem`` and ``key.pem``, and ``root.pem`` for client certificates.
        client_certificates: Whether clients must show one that leads to a root.

    Raises:
        IdentityError: A file cannot be read.
    """

    def set_up(context: ssl.SSLContext) -> None:
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        show(context, folder)
        if client_certificates:
            require_client_certificates(context, folder / ROOT_FILE)

    files = _files(folder) + ([folder / ROOT_FILE] if client_certificates else [])
    return FollowingContext.over(ssl.PROTOCOL_TLS_SERVER, files, set_up)


def require_client_certificates(context: ssl.SSLContext, root_file: Path) -> None:
    """Have a server's context refuse clients without a certificate that leads to a root.

    No tickets are given out: a resumed session carries no chain that could be judged again.

    Raises:
        IdentityError: The roots cannot be read.
    """
    _trust(context, root_file)
    context.verify_mode = ssl.CERT_REQUIRED
    context.options |= ssl.OP_NO_TICKET
    context.num_tickets = 0


def _versions(files: Sequence[Path]) -> tuple[Version, ...] | None:
    """Of files as they are now; ``None`` where one is missing."""
    try:
        return tuple(version(file) for file in files)
    except OSError:
        return None


def _files(folder: Path | None) -> list[Path]:
    return [] if folder is None else [folder / CHAIN_FILE, folder / KEY_FILE]


def _trust(context: ssl.SSLContext, root_file: Path) -> None:
    try:
        context.load_verify_locations(cafile=root_file)
    except (OSError, ssl.SSLError) as error:
        raise IdentityError(f"{root_file}: no root certificate can be read: {error}") from error


def show(context: ssl.SSLContext, directory: Path) -> None:
    """Have a context show the certificate of a folder (``chain.pem``, ``key.pem``).

    Raises:
        IdentityError: It cannot be used.
    """
    # As `Identity.load`: one of the three fits the key, in the middle of a renewal, too.
    faults = []
    for chain_file in (CHAIN_FILE, f"{NEXT}/{CHAIN_FILE}", CHAIN_FILE):
        try:
            context.load_cert_chain(directory / chain_file, directory / KEY_FILE)
        except (OSError, ssl.SSLError) as error:
            faults.append(error)
        else:
            return
    raise IdentityError(f"{directory}: identity cannot be used for TLS: {faults[-1]}")
