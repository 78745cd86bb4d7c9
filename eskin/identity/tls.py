"""TLS contexts: version 1.2 at least, both sides always checked, no way to turn it off."""

from __future__ import annotations

import ssl
from typing import TYPE_CHECKING

from eskin.errors import IdentityError
from eskin.identity.identity import CHAIN_FILE, KEY_FILE, ROOT_FILE

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.identity.identity import Identity


def client_context(root_file: Path, identity: Identity | None = None) -> ssl.SSLContext:
    """A client's side: the server must lead to the root and have the host's name.

    Args:
        root_file: PEM of the root CA.
        identity: Shown to a server that asks; must be on disk.

    Raises:
        IdentityError: A file cannot be read.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_verify_locations(cafile=root_file)
    except (OSError, ssl.SSLError) as error:
        raise IdentityError(f"{root_file}: no root certificate can be read: {error}") from error
    if identity is not None:
        show(context, identity)
    return context


def server_context(identity: Identity, *, client_certificates: bool) -> ssl.SSLContext:
    """A server's side.

    Args:
        identity: Of kind server, on disk.
        client_certificates: Whether clients must show one that leads to the root.

    Raises:
        IdentityError: A file cannot be read.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    show(context, identity)
    if client_certificates:
        context.load_verify_locations(cafile=identity.directory / ROOT_FILE)
        context.verify_mode = ssl.CERT_REQUIRED
    return context


def show(context: ssl.SSLContext, identity: Identity) -> None:
    """Show an identity in all handshakes from now on; a renewed one replaces the one before.

    Raises:
        IdentityError: Its files cannot be used.
    """
    directory = identity.directory
    try:
        context.load_cert_chain(directory / CHAIN_FILE, directory / KEY_FILE)
    except (OSError, ssl.SSLError) as error:
        raise IdentityError(f"{directory}: identity cannot be used for TLS: {error}") from error
