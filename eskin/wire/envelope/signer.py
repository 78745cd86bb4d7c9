"""Signing messages: COSE_Sign1 (RFC 9052, section 4.2) with ES256 (RFC 9053, section 2.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cbor2
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature
from cryptography.hazmat.primitives.hashes import SHA256

from eskin.identity.certificates import der
from eskin.wire.envelope.cose_labels import ALG, ES256, SIGN1, SIGNATURE_BYTES, SIGNER_CHAIN

if TYPE_CHECKING:
    from eskin.identity.identity import Identity


def sign(plaintext: bytes, *, own: Identity, topic: str) -> bytes:
    """Sign a message; the signer's certificate chain goes with it, under its signature.

    Args:
        plaintext: The message.
        own: The signer.
        topic: Where it will be published; the signature is good under no other.
    """
    chain = [der(certificate) for certificate in own.chain]
    protected = cbor2.dumps({ALG: ES256, SIGNER_CHAIN: chain})
    signed = signed_data(protected, plaintext, topic)
    r, s = decode_dss_signature(own.key.sign(signed, ec.ECDSA(SHA256())))
    half = SIGNATURE_BYTES // 2
    signature = r.to_bytes(half) + s.to_bytes(half)
    return cbor2.dumps(cbor2.CBORTag(SIGN1, [protected, {}, plaintext, signature]))


def signed_data(protected: bytes, plaintext: bytes, topic: str) -> bytes:
    """Sig_structure of RFC 9052, section 4.4."""
    return cbor2.dumps(["Signature1", protected, topic.encode(), plaintext])
