"""A party's side of the CA service: ask for a certificate, fetch a public one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import httpx
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.x509.oid import NameOID

from eskin.errors import IdentityError
from eskin.identity import Identity, client_context, new_key
from eskin.identity.identity import KEY_FILE, load_key, save_key, write_whole

if TYPE_CHECKING:
    from pathlib import Path

    from cryptography.hazmat.primitives.asymmetric import ec

    from eskin.identity import IdentityKind

_TIMEOUT_S = 10.0


class NotReadyError(IdentityError):
    """The service, the token or the certificate is not there yet; ask again."""


def enrol(url: str, directory: Path, name: str, out: Path) -> Identity:
    """Have a key certified.

    The key is made in ``out`` before the first attempt and kept, so that a second attempt after a
    lost answer asks for the same key.

    Args:
        url: The CA service.
        directory: Holds ``root.pem`` and ``NAME.token``.
        name: Common name.
        out: Folder of the identity.

    Raises:
        NotReadyError: Token or service are not there yet.
        IdentityError: The service refuses.
    """
    token = _waited(directory / f"{name}.token")
    key = _key(out)
    answer = _ask(
        "POST", url, directory, "/enrol", {"token": token.decode(), "request": _request(key, name)}
    )
    body = answer.json()
    chain = tuple(x509.load_pem_x509_certificates(body["chain"].encode()))
    root = x509.load_pem_x509_certificate(_waited(directory / "root.pem"))
    return Identity.save(out, key=key, chain=chain, root=root)


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
    answer = _ask("GET", url, directory, f"/anchors/{kind}", None)
    write_whole(out, answer.content)


def _ask(
    method: str, url: str, directory: Path, path: str, body: dict[str, str] | None
) -> httpx.Response:
    root = directory / "root.pem"
    _waited(root)
    try:
        with httpx.Client(verify=client_context(root), timeout=_TIMEOUT_S) as client:
            answer = client.request(method, url.rstrip("/") + path, json=body)
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


def _request(key: ec.EllipticCurvePrivateKey, name: str) -> str:
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    request = x509.CertificateSigningRequestBuilder(subject_name=subject).sign(key, hashes.SHA256())
    return request.public_bytes(serialization.Encoding.PEM).decode()
