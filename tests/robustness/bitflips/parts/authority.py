"""A CA's folder: what was revoked stays revoked, and what was issued stays known."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from eskin_ca.tokens import TOKENS_FILE, Tokens

from eskin.errors import EskinError, IdentityError, UntrustedCertificateError
from eskin.identity import CertificateAuthority, ChainVerifier, IdentityKind, new_key
from eskin.identity.certificates import pem
from eskin.identity.identity import load_key, save_key
from tests.robustness.bitflips.part import Part

if TYPE_CHECKING:
    from pathlib import Path

_SITE: Final = "site.main"
_GOOD: Final = "fingertip"
_REVOKED: Final = "palm"


def make(folder: Path) -> None:
    """Issue to two nodes and revoke one; one token is used, one of a fleet in part."""
    ca = folder / "ca"
    authority = CertificateAuthority.open(ca)
    tokens = Tokens(ca / TOKENS_FILE)
    said = [
        tokens.create(IdentityKind.NODE, name, (), timedelta(days=1), lines=0, site=_SITE)
        for name in (_GOOD, _REVOKED)
    ]
    said.append(
        tokens.create(
            IdentityKind.NODE, "glove", (), timedelta(days=1), lines=0, site=_SITE, count=3
        )
    )
    for name, token in zip((_GOOD, _REVOKED, "glove-0001"), said, strict=True):
        key = new_key()
        tokens.redeem(token, _public(key), name)
        chain = authority.issue(IdentityKind.NODE, name, key.public_key(), site=_SITE)
        save_key(folder / f"{name}.key", key)
        (folder / f"{name}.pem").write_bytes(pem(chain))
    (folder / "tokens").write_text(" ".join(said))
    authority.revoke(_REVOKED)
    save_key(folder / "other.key", new_key())


def _public(key: Any) -> bytes:
    from cryptography.hazmat.primitives.serialization import PublicFormat  # noqa: PLC0415

    found: bytes = key.public_key().public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    return found


def read(folder: Path) -> dict[str, Any]:
    """Ask as the CA's service does, then have others follow its list."""
    authority = CertificateAuthority.open(folder / "ca")
    keys = {name: load_key(folder / f"{name}.key") for name in (_GOOD, _REVOKED, "other")}
    chains = {
        name: x509.load_pem_x509_certificates((folder / f"{name}.pem").read_bytes())
        for name in (_GOOD, _REVOKED)
    }
    tokens = Tokens(folder / "ca" / TOKENS_FILE)
    trust = ChainVerifier(*authority.roots)
    kind = IdentityKind.NODE
    trust.revocations(kind, authority.revocations_file(kind).read_bytes())
    found: dict[str, Any] = {}
    for name, chain in chains.items():
        found[f"{name} is revoked"] = authority.is_revoked(chain[0])
        found[f"{name} was revoked"] = authority.register.revocation(name) is not None
        found[f"{name} is trusted"] = _does(
            lambda chain=chain: trust.verify([c.public_bytes(Encoding.DER) for c in chain], kind)
        )
        found[f"{name} is known"] = authority.latest(name) is not None or None
    for name, token in zip(
        (_GOOD, _REVOKED), (folder / "tokens").read_text().split(), strict=False
    ):
        for holder in (_GOOD, _REVOKED, "other"):
            found[f"token of {name} for {holder}"] = _does(
                lambda token=token, holder=holder: tokens.judge(
                    token, _public(keys[holder]), revocation=authority.register.revocation
                )
            )
    found["key may be used again"] = _does(
        lambda: authority.issue(kind, "again", keys[_REVOKED].public_key(), site=_SITE)
    )
    found["fleet's name for another"] = _does(
        lambda: tokens.judge(
            (folder / "tokens").read_text().split()[2], _public(keys["other"]), "glove-0001"
        )
    )
    found["other site"] = _does(lambda: authority.register.require_site(_GOOD, "site.other"))
    fresh = authority.issue(kind, "fresh", keys["other"].public_key(), site=_SITE)
    found["fresh"] = _does(
        lambda: trust.verify([c.public_bytes(Encoding.DER) for c in fresh], kind)
    )
    authority.write_revocations(kind)
    trust.revocations(kind, authority.revocations_file(kind).read_bytes())
    return {name: value for name, value in found.items() if value is not None}


def _does(ask: Any) -> bool:
    """Whether something is allowed."""
    try:
        ask()
    except (UntrustedCertificateError, IdentityError) as error:
        if "damaged" in str(error):
            raise
        return False
    except EskinError:
        raise
    return True


PART: Final = Part(make, read, ("ca/*", "ca/issued/*"))
