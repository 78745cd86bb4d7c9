"""Checking what a node signed when its gesture key was entered."""

from __future__ import annotations

import base64
import binascii
from typing import TYPE_CHECKING

from eskin.errors import MalformedEnvelopeError
from eskin.identity import ChainVerifier, IdentityKind
from eskin.wire.envelope import Verifier
from eskin.wire.messages import Release
from eskin.wire.topics import Stream, node_topic

if TYPE_CHECKING:
    from pathlib import Path


def verify_release(signature: str, *, node: str, nonce: str, root: Path) -> Release:
    """Check that a node signed a challenge, as its gesture key was entered.

    Args:
        signature: What the node reports, base64.
        node: Which node must have signed.
        nonce: The challenge's, 32 hexadecimal digits.
        root: PEM file of the root CA; revocation lists are read beside it.

    Returns:
        What was signed: the nonce, and when.

    Raises:
        EnvelopeError: It is no signature, or none over this nonce.
        IdentityError: Another party signed it, or the root cannot be read.
        MessageError: What was signed is no release.
    """
    try:
        signed = base64.b64decode(signature, validate=True)
    except binascii.Error as error:
        raise MalformedEnvelopeError(f"the signature is no base64: {error}") from error
    verifier = Verifier(ChainVerifier.following(root), kind=IdentityKind.NODE, name=node)
    release = Release.decode(verifier.verify(signed, topic=node_topic(node, Stream.COMMANDS)))
    if release.node != node or release.nonce.hex() != nonce:
        raise MalformedEnvelopeError(
            f"it is signed for nonce {release.nonce.hex()} at {release.node}, which is another one"
        )
    return release
