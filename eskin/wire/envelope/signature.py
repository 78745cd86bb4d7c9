"""Sign and verify messages: COSE_Sign1 (RFC 9052, section 4.2) with ES256 (RFC 9053, 2.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cbor2
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import (
    decode_dss_signature,
    encode_dss_signature,
)
from cryptography.hazmat.primitives.hashes import SHA256

from eskin.errors import (
    ForgedEnvelopeError,
    MalformedEnvelopeError,
    UntrustedCertificateError,
)
from eskin.identity.certificates import common_name, der, public_key
from eskin.wire.envelope.header import (
    ALG,
    ES256,
    SIGN1,
    SIGNATURE_BYTES,
    SIGNER_CHAIN,
    load_header,
    read_tagged,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.identity.chain_verifier import ChainVerifier
    from eskin.identity.identity import Identity
    from eskin.identity.identity_kind import IdentityKind


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


class Verifier:
    """Takes messages of one signer only.

    Args:
        chains: Verifies certificate chains.
        kind: The signer's kind.
        name: Its common name.
    """

    def __init__(self, chains: ChainVerifier, *, kind: IdentityKind, name: str) -> None:
        self._chains = chains
        self._kind = kind
        self._name = name

    def verify(self, signed: bytes, *, topic: str) -> bytes:
        """Check a message, and give what it says.

        Args:
            signed: The COSE_Sign1.
            topic: Where it arrived.

        Raises:
            MalformedEnvelopeError: The bytes are no COSE_Sign1 of ours.
            UntrustedCertificateError: The signer's chain leads elsewhere, is not valid now, or is
                another party's.
            ForgedEnvelopeError: The signature is wrong.
        """
        protected, plaintext, signature = _read_parts(signed)
        header = load_header(protected)
        if header.get(ALG) != ES256:
            raise MalformedEnvelopeError("algorithm is not ES256 (-7)")
        if len(signature) != SIGNATURE_BYTES:
            raise MalformedEnvelopeError(f"signature is not {SIGNATURE_BYTES} bytes")
        leaf = self._chains.verify(_chain(header), self._kind)
        if common_name(leaf) != self._name:
            raise UntrustedCertificateError(
                f"signed by {common_name(leaf)!r}; only {self._name!r} may sign here"
            )
        half = SIGNATURE_BYTES // 2
        encoded = encode_dss_signature(
            int.from_bytes(signature[:half]), int.from_bytes(signature[half:])
        )
        try:
            public_key(leaf).verify(
                encoded, signed_data(protected, plaintext, topic), ec.ECDSA(SHA256())
            )
        except InvalidSignature as error:
            raise ForgedEnvelopeError(
                f"the signature of {self._name!r} on {topic!r} is wrong"
            ) from error
        return plaintext


def signer_chain(signed: bytes) -> tuple[bytes, ...]:
    """The chain (DER) that a signed message names as its signer's; not verified.

    Raises:
        MalformedEnvelopeError: The bytes are no COSE_Sign1 of ours.
    """
    return _chain(load_header(_read_parts(signed)[0]))


def _chain(header: Mapping[object, object]) -> tuple[bytes, ...]:
    chain = header.get(SIGNER_CHAIN)
    if not isinstance(chain, list) or not all(isinstance(item, bytes) for item in chain):
        raise MalformedEnvelopeError("header x5chain is no array of byte strings")
    return tuple(chain)


def _read_parts(signed: bytes) -> tuple[bytes, bytes, bytes]:
    protected, _, plaintext, signature = read_tagged(signed, SIGN1, 4, "COSE_Sign1")
    return protected, plaintext, signature
