"""A party's side of the CA service: ask for a certificate, fetch a public one."""

from __future__ import annotations

import base64
import contextlib
import time
from typing import TYPE_CHECKING, TypeVar

import httpx
from cryptography import x509
from cryptography.hazmat.primitives import serialization

from authority.requests import make_request
from eskin.envelope import sign
from eskin.errors import IdentityError
from eskin.identity import (
    Identity,
    IdentityKind,
    Trust,
    client_context,
    common_name,
    der,
    install,
    load_certificates,
    new_key,
    next_key,
    numbered,
)
from eskin.identity.identity import CHAIN_FILE, KEY_FILE, ROOT_FILE, load_key, save_key, write_whole
from eskin.topics import RENEWAL

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from cryptography.hazmat.primitives.asymmetric import ec

T = TypeVar("T")

_TIMEOUT_S = 10.0


class NotReadyError(IdentityError):
    """The service, the token or the certificate is not there yet; ask again."""


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
    token = _waited(directory / f"{stem or name}.token")
    key = _key(out)
    request = make_request(key, name).public_bytes(serialization.Encoding.PEM).decode()
    body = {"token": token.decode(), "request": request}
    answer = _ask("POST", url, directory, "/enrol", body, client)
    chain = tuple(x509.load_pem_x509_certificates(answer.json()["chain"].encode()))
    root = x509.load_pem_x509_certificate(_waited(directory / "root.pem"))
    return Identity.save(out, key=key, chain=chain, root=root)


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
    with contextlib.closing(_Connection(directory)) as connection:
        for name in numbered(stem, count):
            own = out / name
            if (own / CHAIN_FILE).exists():
                yield Identity.load(own)
            else:
                yield patiently(
                    lambda own=own: enrol(  # type: ignore[misc]  # mypy infers no default
                        url, directory, own.name, own, stem=stem, client=connection.client()
                    ),
                    patience,
                )


def patiently(ask: Callable[[], T], patience: float) -> T:
    """Ask again each second while the service is away or not ready.

    Raises:
        IdentityError: It was for as many seconds as patience lasts.
    """
    deadline = time.monotonic() + patience
    while True:
        try:
            return ask()
        except NotReadyError as error:
            if time.monotonic() > deadline:
                raise IdentityError(f"gave up after {patience:g} s: {error}") from error
            time.sleep(1.0)


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
    answer = _ask("POST", url, directory, "/renew", body)
    chain = tuple(x509.load_pem_x509_certificates(answer.json()["chain"].encode()))
    Trust(own.root).verify([der(certificate) for certificate in chain], own.kind)
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
    content = _ask("GET", url, directory, f"/certificates/{name}", None).content
    if out.exists() and out.read_bytes() == content:
        return False
    root = load_certificates(directory / ROOT_FILE)[0]
    chain = x509.load_pem_x509_certificates(content)
    leaf = Trust(root).verify([der(certificate) for certificate in chain], IdentityKind.SITE)
    if common_name(leaf) != name:
        raise IdentityError(f"{url} gave {common_name(leaf)!r} for {name!r}")
    write_whole(out, content)
    return True


def fetch_revocations(url: str, directory: Path, kind: IdentityKind, out: Path) -> bool:
    """Fetch a kind's revocation list if there is another than the one that is held.

    Raises:
        NotReadyError: The service is away.
    """
    content = _ask("GET", url, directory, f"/revocations/{kind}", None).content
    if out.exists() and out.read_bytes() == content:
        return False
    write_whole(out, content)
    return True


def fetch_revoked(url: str, directory: Path, kind: IdentityKind) -> set[tuple[str, str]]:
    """Name and serial number of each revoked certificate of a kind.

    Raises:
        NotReadyError: The service is away.
    """
    items = _ask("GET", url, directory, f"/revoked/{kind}", None).json()["items"]
    return {(item["name"], item["serial"]) for item in items}


def fetch(url: str, directory: Path, name: str, out: Path) -> None:
    """Fetch the chain that was last issued to a name.

    Raises:
        NotReadyError: It was not issued yet, or the service is away.
    """
    answer = _ask("GET", url, directory, f"/certificates/{name}", None)
    write_whole(out, answer.content)


def fetch_anchor(url: str, directory: Path, kind: IdentityKind, out: Path) -> None:
    """Fetch the anchor of a kind, with which a TLS server takes that kind and no other.

    Raises:
        NotReadyError: The service is away.
    """
    content = _ask("GET", url, directory, f"/anchors/{kind}", None).content
    if not out.exists() or out.read_bytes() != content:
        write_whole(out, content)


class _Connection:
    """A connection to the service that is made when it is first needed, and stays."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._client: httpx.Client | None = None

    def client(self) -> httpx.Client:
        """The connection.

        Raises:
            NotReadyError: The root's certificate is not there yet.
        """
        if self._client is None:
            self._client = _client(self._directory)
        return self._client

    def close(self) -> None:
        """Close it."""
        if self._client is not None:
            self._client.close()


def _client(directory: Path) -> httpx.Client:
    root = directory / "root.pem"
    _waited(root)
    return httpx.Client(verify=client_context(root), timeout=_TIMEOUT_S)


def _ask(
    method: str,
    url: str,
    directory: Path,
    path: str,
    body: dict[str, str] | None,
    client: httpx.Client | None = None,
) -> httpx.Response:
    own = client or _client(directory)
    try:
        with contextlib.nullcontext(own) if client else own:
            answer = own.request(method, url.rstrip("/") + path, json=body)
    except httpx.TransportError as error:
        raise NotReadyError(f"{url} cannot be reached: {error}") from error
    if answer.status_code == httpx.codes.NOT_FOUND or answer.is_server_error:
        raise NotReadyError(f"{url}{path} answered {answer.status_code}: {answer.text[:200]}")
    if answer.is_error:
        raise IdentityError(f"{url}{path} refused: {answer.text[:300]}")
    return answer


def _waited(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise NotReadyError(f"{path} cannot be read: {error.strerror}") from error


def _key(out: Path) -> ec.EllipticCurvePrivateKey:
    path = out / KEY_FILE
    if path.exists():
        return load_key(path)
    key = new_key()
    out.mkdir(parents=True, exist_ok=True, mode=0o700)
    save_key(path, key)
    return key
