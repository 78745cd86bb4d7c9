"""Sealed messages: COSE_Encrypt0 (RFC 9052, section 5.2) with AES-256-GCM (RFC 9053, section 4.1).

The content key comes from static-static ECDH P-256 between the sender's and the recipient's
certificates, through HKDF-SHA-256 with a COSE_KDF_Context (RFC 9053, sections 5.1, 5.2 and 6.3).

Nonces never repeat: every start of every sender draws a fresh salt from the operating system and
counts from zero under the key that this salt gives. Both parties are in the context, so each
direction has keys of its own.

Protected header: 1 alg (A256GCM), -20 salt, -27 x5t-sender and 34 x5t (RFC 9360: sender's and
recipient's certificates), and ``HELD``: the lowest boot and sequence that the sender still holds.
Unprotected: 5 IV, and -29 x5chain-sender where the sender introduces itself.
External data: the topic. So a message moved to another topic is no message.

What must hold from end to end, past the gateways, is signed: COSE_Sign1 (RFC 9052, section 4.2)
with ES256 (RFC 9053, section 2.1). Protected header: 1 alg (ES256) and 33 x5chain (RFC 9360).
External data: the topic.
"""

from __future__ import annotations

from eskin.wire.envelope.encrypt0 import Opened, Opener, Sealer
from eskin.wire.envelope.header import HELD, MOST_ENVELOPE, introduction
from eskin.wire.envelope.signature import Verifier, sign, signer_chain

__all__ = [
    "HELD",
    "MOST_ENVELOPE",
    "Opened",
    "Opener",
    "Sealer",
    "Verifier",
    "introduction",
    "sign",
    "signer_chain",
]
