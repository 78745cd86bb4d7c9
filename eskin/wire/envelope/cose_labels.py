"""Header labels and numbers of our COSE_Encrypt0 (RFC 9052, 9053, 9360)."""

from __future__ import annotations

from typing import Final

from eskin.wire.messages.cbor_map import MOST_BYTES

MOST_ENVELOPE: Final = MOST_BYTES + 8_192
"""Size limit of a sealed message: the message, headers and a certificate chain."""
ENCRYPT0: Final = 16
"""CBOR tag."""
ALG: Final = 1
A256GCM: Final = 3
IV: Final = 5
IV_BYTES: Final = 12
SALT: Final = -20
SALT_BYTES: Final = 16
SENDER: Final = -27
"""Header x5t-sender."""
RECIPIENT: Final = 34
"""Header x5t."""
CHAIN: Final = -29
"""Header x5chain-sender."""
SHA256_ID: Final = -16
HELD: Final = -70_001
"""Header (private use) with the lowest position that a node still holds."""
SIGN1: Final = 18
"""CBOR tag."""
ES256: Final = -7
SIGNATURE_BYTES: Final = 64
"""Of ES256: r and s, 32 bytes each."""
SIGNER_CHAIN: Final = 33
"""Header x5chain."""
