"""One party's identity: its private key, its certificate chain, and the roots that it trusts.

Its folder holds ``key.pem`` (0600), ``chain.pem`` (its certificate, then the issuing CA's) and
``root.pem``.
"""

from __future__ import annotations

import functools
import os
import secrets
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from eskin.errors import IdentityError
from eskin.identity.certificates import (
    UNREADABLE,
    common_name,
    der,
    issuer_kind,
    pem,
    read_certificate,
    site_of,
    thumbprint,
)
from eskin.runtime.files.create import create, make_folder

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.identity.identity_kind import IdentityKind

KEY_FILE: Final = "key.pem"
CHAIN_FILE: Final = "chain.pem"
ROOT_FILE: Final = "root.pem"
NEXT: Final = "next"
"""Folder inside an identity's, with the key, and then the chain, that will replace its own."""


@dataclass(frozen=True, slots=True)
class Identity:
    """A private key with its certificates.

    Attributes:
        directory: Where it lives.
        key: The private key, EC P-256.
        chain: The certificate, then the issuing CA's.
        roots: The root CAs' certificates, the only anchors of trust; the one that issues is first.
        thumbprint: SHA-256 of its certificate.
    """

    directory: Path
    key: ec.EllipticCurvePrivateKey
    chain: tuple[x509.Certificate, ...]
    roots: tuple[x509.Certificate, ...]
    thumbprint: bytes = field(init=False, compare=False)

    def __post_init__(self) -> None:
        # Asked for with each message: hashed once.
        object.__setattr__(self, "thumbprint", thumbprint(self.chain[0]))

    @classmethod
    def load(cls, directory: Path) -> Self:
        """Read an identity from its folder.

        Raises:
            IdentityError: A file is missing, is no PEM, or key and certificate do not belong
                together.
        """
        try:
            return cls._read(directory)
        except IdentityError as error:
            if not isinstance(error.__cause__, FileNotFoundError | NotADirectoryError):
                raise
            raise IdentityError(
                f"{error}; have `eskin pki issue` or `eskin pki enrol` make the identity there, "
                "by --out"
            ) from error

    @classmethod
    def _read(cls, directory: Path) -> Self:
        # A renewal replaces the key, then the chain, and keeps the new chain in NEXT meanwhile: one
        # of the three fits, whenever it is looked at, or whenever it was cut off.
        for chain_file in (CHAIN_FILE, f"{NEXT}/{CHAIN_FILE}", CHAIN_FILE):
            key = load_key(directory / KEY_FILE)
            if not (directory / chain_file).exists() and chain_file != CHAIN_FILE:
                continue
            chain = load_certificates(directory / chain_file)
            if chain[0].public_key() == key.public_key():
                return cls(directory, key, chain, load_certificates(directory / ROOT_FILE))
        raise IdentityError(f"{directory}: {KEY_FILE} does not belong to {CHAIN_FILE}")

    @classmethod
    def save(
        cls,
        directory: Path,
        *,
        key: ec.EllipticCurvePrivateKey,
        chain: tuple[x509.Certificate, ...],
        roots: tuple[x509.Certificate, ...],
    ) -> Self:
        """Write an identity to its folder; the chain last, so that its presence means all is there.

        Raises:
            IdentityError: The folder cannot be written.
        """
        try:
            make_folder(directory)
            save_key(directory / KEY_FILE, key)
            write_whole(directory / ROOT_FILE, pem(roots))
            write_whole(directory / CHAIN_FILE, pem(chain))
        except OSError as error:
            raise IdentityError(f"{directory}: identity cannot be written: {error}") from error
        return cls(directory, key, chain, roots)

    @property
    def certificate(self) -> x509.Certificate:
        """The identity's own certificate."""
        return self.chain[0]

    @property
    def name(self) -> str:
        """Its common name."""
        return common_name(self.certificate)

    @property
    def kind(self) -> IdentityKind:
        """Its kind, as its issuing CA says."""
        return issuer_kind(self.certificate)

    @property
    def site(self) -> str:
        """The common name of its site.

        Raises:
            IdentityError: It is neither a node nor a gateway.
        """
        return site_of(self.certificate)


def load_certificates(path: Path) -> tuple[x509.Certificate, ...]:
    """Read the certificates of a PEM file.

    Raises:
        IdentityError: It cannot be read, or holds none.
    """
    try:
        return _certificates(path.read_bytes())
    except OSError as error:
        raise IdentityError(f"{path}: no certificate can be read: {error.strerror}") from error
    except (IdentityError, *UNREADABLE) as error:
        raise IdentityError(f"{path}: no certificate can be read: {error}") from error


@functools.lru_cache(16)
def _certificates(data: bytes) -> tuple[x509.Certificate, ...]:
    """Read once what many identities have in common, as a fleet's have their roots."""
    return tuple(read_certificate(der(one)) for one in x509.load_pem_x509_certificates(data))


def load_key(path: Path) -> ec.EllipticCurvePrivateKey:
    """Read a private key.

    Raises:
        IdentityError: It cannot be read, is no P-256 key, or others may read it.
    """
    try:
        if path.stat().st_mode & 0o077:
            raise IdentityError(f"{path}: others may read this private key; chmod 600 it")
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    except OSError as error:
        raise IdentityError(f"{path}: no private key can be read: {error.strerror}") from error
    except UNREADABLE as error:
        raise IdentityError(f"{path}: no private key can be read: {error}") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey) or not isinstance(key.curve, ec.SECP256R1):
        raise IdentityError(f"{path}: the key is not on the curve P-256")
    return key


def save_key(path: Path, key: ec.EllipticCurvePrivateKey) -> None:
    """Write a private key that only its owner may read."""
    data = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    write_whole(path, data, mode=0o600)


def write_whole(path: Path, data: bytes, *, mode: int = 0o644) -> None:
    """Replace a file's content at once: a reader, or a crash, sees the old or the new, never half.

    Raises:
        OSError: It cannot be written.
    """
    # Not by the process's number: in containers that share a folder, many have the same.
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    descriptor = create(partial, mode=mode)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise
