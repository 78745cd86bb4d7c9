"""COSE_Sign1: signed commands with anything changed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.errors import EnvelopeError, UntrustedCertificateError
from eskin.identity import ChainVerifier, IdentityKind
from eskin.wire.envelope import Verifier, sign, signer_chain
from tests.robustness.fuzz.mutations.trees import mutate_tree
from tests.robustness.fuzz.target import Target
from tests.support.identities import Identities

if TYPE_CHECKING:
    from pathlib import Path

TOPIC = "eskin/v1/nodes/fingertip/commands"


def make(folder: Path) -> Target:
    """Only the documented errors; what passes is what was signed."""
    identities = Identities(folder / "identities")
    server = identities.make(IdentityKind.SERVER, "server.cloud")
    trust = ChainVerifier(*identities.authority.roots)
    verifier = Verifier(trust, kind=IdentityKind.SERVER, name="server.cloud")
    said = [b"command", b""]

    def check(data: bytes) -> None:
        try:
            signer_chain(data)
            assert verifier.verify(data, topic=TOPIC) in said, "no sender signed this"
        except (EnvelopeError, UntrustedCertificateError):
            return

    return Target(tuple(sign(text, own=server, topic=TOPIC) for text in said), mutate_tree, check)
