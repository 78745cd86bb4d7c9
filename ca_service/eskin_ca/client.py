"""A party's side of the CA service: ask for a certificate, fetch a public one."""

from __future__ import annotations

import base64
import contextlib
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING

from cryptography import x509
from cryptography.hazmat.primitives import serialization

from eskin.errors import IdentityError
from eskin.identity import (
    ChainVerifier,
    Identity,
    IdentityKind,
    common_name,
    der,
    install,
    load_certificates,
    new_key,
    next_key,
    numbered,
)
from eskin.identity.certificates import pem
from eskin.identity.identity import CHAIN_FILE, KEY_FILE, ROOT_FILE, load_key, save_key, write_whole
from eskin.identity.roots import accept_roots
from eskin.runtime.files.create import make_folder
from eskin.wire.envelope import sign
from eskin.wire.topics import RENEWAL
from eskin_ca.csr import make_request
from eskin_ca.http_client import Connection, ask, patiently, waited

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import httpx
    from cryptography.hazmat.primitives.asymmetric import ec


def enrol(
    url: str,
    directory: Path,
    name: str,
    out: Path,
    *,
    stem: str | None = None,
    client: httpx.Client | None = None,
) -> Identity:
    """Have a key certified.

    The key is made in ``out`` before the first attempt and kept, so that a second attempt after a
    lost answer asks for the same key.

    Args:
        url: The CA service.
        directory: Holds ``root.pem`` and ``NAME.token``.
        name: Common name.
        out: Folder of the identity.
        stem: Name of the fleet whose token it is.
        client: A connection that stays.

    Raises:
        NotReadyError: Token or service are not there yet.
        IdentityError: The service refuses.
    """
    token = waited(directory / f"{stem or name}.token")
    key = _key(out)
    request = make_request(key, name).public_bytes(serialization.Encoding.PEM).decode()
    body = {"token": token.decode(), "request": request}
    answer = ask("POST", url, directory, "/enrol", body, client)
    chain = tuple(x509.load_pem_x509_certificates(answer.json()["chain"].encode()))
    waited(directory / ROOT_FILE)
    roots = load_certificates(directory / ROOT_FILE)
    return Identity.save(out, key=key, chain=chain, roots=roots)


def enrol_fleet(
    url: str, directory: Path, stem: str, count: int, out: Path, *, patience: float
) -> Iterator[Identity]:
    """Have the keys of a fleet certified, one after the other over one connection.

    Who has a certificate already is only looked at, so that what was cut off goes on.

    Args:
        url: The CA service.
        directory: Holds ``root.pem`` and ``STEM.token``.
        stem: What the names begin with.
        count: How many.
        out: Folder that takes a folder for each.
        patience: Seconds to keep trying while the service is away.

    Yields:
        Each identity.

    Raises:
        IdentityError: The service refuses, or was away for too long.
    """
    with contextlib.closing(Connection(directory)) as connection:

        def ask_for(own: Path) -> Identity:
            return enrol(url, directory, own.name, own, stem=stem, client=connection.client())

        for name in numbered(stem, count):
            own = out / name
            if (own / CHAIN_FILE).exists():
                yield Identity.load(own)
            else:
                yield patiently(partial(ask_for, own), patience)


def renew(url: str, directory: Path) -> Identity:
    """Have an identity renewed, with a fresh key; the old one goes to its past.

    Args:
        url: The CA service.
        directory: Folder of the identity.

    Raises:
        NotReadyError: The service is away.
        IdentityError: The service refuses, or the folder cannot be used.
    """
    own = Identity.load(directory)
    request = make_request(next_key(directory), own.name)
    signed = sign(request.public_bytes(serialization.Encoding.DER), own=own, topic=RENEWAL)
    body = {"signed": base64.b64encode(signed).decode()}
    answer = ask("POST", url, directory, "/renew", body)
    chain = tuple(x509.load_pem_x509_certificates(answer.json()["chain"].encode()))
    ChainVerifier(*own.roots).verify([der(certificate) for certificate in chain], own.kind)
    return install(directory, chain)


def fetch_site(url: str, directory: Path, name: str, out: Path) -> bool:
    """Fetch a site's certificate if there is another than the one that is held.

    Args:
        url: The CA service.
        directory: Holds ``root.pem``.
        name: The site.
        out: PEM file.

    Raises:
        NotReadyError: The service is away.
        IdentityError: What it gives is no certificate of a site.
    """
    content = ask("GET", url, directory, f"/certificates/{name}", None).content
    if out.exists() and out.read_bytes() == content:
        return False
    roots = load_certificates(directory / ROOT_FILE)
    chain = x509.load_pem_x509_certificates(content)
    leaf = ChainVerifier(*roots).verify(
        [der(certificate) for certificate in chain], IdentityKind.SITE
    )
    if common_name(leaf) != name:
        raise IdentityError(f"{url} gave {common_name(leaf)!r} for {name!r}")
    write_whole(out, content)
    return True


def fetch_roots(url: str, *directories: Path) -> list[Path]:
    """Fetch the roots that stand, for identities that trust others.

    A new one is taken only where one that is trusted vouches for it.

    Args:
        url: The CA service.
        directories: Folders of identities; with the first one's roots the service is asked.

    Returns:
        Those whose roots were replaced.

    Raises:
        NotReadyError: The service is away.
        IdentityError: One of them is not certified.
    """
    content = ask("GET", url, directories[0], "/roots", None).content
    offered = x509.load_pem_x509_certificates(content)
    now, replaced = datetime.now(UTC), []
    accepted: dict[tuple[x509.Certificate, ...], tuple[x509.Certificate, ...]] = {}
    for directory in directories:
        trusted = load_certificates(directory / ROOT_FILE)
        if trusted not in accepted:
            accepted[trusted] = accept_roots(trusted, offered, now)
        roots = accepted[trusted]
        if roots != trusted:
            write_whole(directory / ROOT_FILE, pem(roots))
            replaced.append(directory)
    return replaced


def fetch_revocations(url: str, directory: Path, kind: IdentityKind, out: Path) -> bool:
    """Fetch a kind's revocation list if there is another than the one that is held.

    Raises:
        NotReadyError: The service is away.
    """
    content = ask("GET", url, directory, f"/revocations/{kind}", None).content
    if out.exists() and out.read_bytes() == content:
        return False
    write_whole(out, content)
    return True


def fetch_revoked(url: str, directory: Path, kind: IdentityKind) -> set[tuple[str, str]]:
    """Name and serial number of each revoked certificate of a kind.

    Raises:
        NotReadyError: The service is away.
    """
    items = ask("GET", url, directory, f"/revoked/{kind}", None).json()["items"]
    return {(item["name"], item["serial"]) for item in items}


def fetch(url: str, directory: Path, name: str, out: Path) -> None:
    """Fetch the chain that was last issued to a name.

    Raises:
        NotReadyError: It was not issued yet, or the service is away.
    """
    answer = ask("GET", url, directory, f"/certificates/{name}", None)
    write_whole(out, answer.content)


def fetch_anchor(url: str, directory: Path, kind: IdentityKind, out: Path) -> None:
    """Fetch the anchor of a kind, with which a TLS server takes that kind and no other.

    Raises:
        NotReadyError: The service is away.
    """
    content = ask("GET", url, directory, f"/anchors/{kind}", None).content
    if not out.exists() or out.read_bytes() != content:
        write_whole(out, content)


def _key(out: Path) -> ec.EllipticCurvePrivateKey:
    path = out / KEY_FILE
    if path.exists():
        return load_key(path)
    key = new_key()
    make_folder(out)
    save_key(path, key)
    return key
