"""A node's identity: key, chain and roots; what it signs must pass, or it must not start."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding

from eskin.identity import ChainVerifier, Identity
from tests.robustness.bitflips.part import Part
from tests.support.identities import Identities

if TYPE_CHECKING:
    from pathlib import Path

_SIGNED: Final = b"said"


def make(folder: Path) -> None:
    """A CA and the node that it knows."""
    Identities(folder)


def read(folder: Path) -> dict[str, Any]:
    """Load it, sign with it, and verify its chain as others do."""
    own = Identity.load(folder / "fingertip")
    algorithm = ec.ECDSA(hashes.SHA256())
    signature = own.key.sign(_SIGNED, algorithm)
    whole = Identity.load(folder / "gateway.g1")
    trusted = ChainVerifier(*whole.roots)
    public = trusted.verify(
        [c.public_bytes(Encoding.DER) for c in own.chain], kind=own.kind
    ).public_key()
    try:
        public.verify(signature, _SIGNED, algorithm)  # type: ignore[union-attr, call-arg, arg-type]
        signs = True
    except InvalidSignature:
        signs = False
    return {"name": own.name, "site": own.site, "signs": signs, "roots": len(own.roots)}


PART: Final = Part(make, read, ("fingertip/*",))
