"""The key that two certificates share under a salt."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cbor2
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from eskin.identity.certificates import common_name, public_key, thumbprint
from eskin.wire.envelope.header import A256GCM

if TYPE_CHECKING:
    from cryptography import x509


def agree_key(
    private: ec.EllipticCurvePrivateKey,
    peer: x509.Certificate,
    sender: x509.Certificate,
    recipient: x509.Certificate,
    salt: bytes,
) -> bytes:
    """ECDH of P-256, then HKDF-SHA-256 with a COSE_KDF_Context (RFC 9053, sections 5.1, 5.2, 6.3).

    Args:
        private: The own key.
        peer: The other party's certificate.
        sender: The sealer's certificate.
        recipient: The opener's certificate.
        salt: The sender's.

    Returns:
        32 bytes.
    """
    secret = private.exchange(ec.ECDH(), public_key(peer))
    parties = [
        [common_name(party).encode(), None, thumbprint(party)] for party in (sender, recipient)
    ]
    context = cbor2.dumps([A256GCM, *parties, [256, b"", b"eskin/v1"]])
    return HKDF(algorithm=SHA256(), length=32, salt=salt, info=context).derive(secret)
