"""A gateway's token: the header as it comes, and claims that a gateway signed."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import jwt

from cloud.ingest.errors import UnauthenticatedError
from cloud.ingest.replay import Replay
from cloud.ingest.warrant import Verifier
from eskin.identity import IdentityKind, Trust
from eskin.moment import SECOND
from tests.cloud.clouds import warrant
from tests.fuzz.mutations.texts import mutate_text
from tests.fuzz.target import Target
from tests.identities import Identities

if TYPE_CHECKING:
    from pathlib import Path

_SIGNED = b"{"
"""What begins so are claims, to be signed; all else is a header."""


def make(folder: Path) -> Target:
    """Only `UnauthenticatedError`; what passes names this gateway."""
    identities = Identities(folder / "identities")
    own = identities.gateway
    trust = Trust(*identities.authority.roots)
    now = own.certificate.not_valid_before_utc
    moment = int(now.timestamp() + 600) * SECOND
    verifier = Verifier(
        lambda chain: trust.verify(chain, IdentityKind.GATEWAY),
        skew=30.0,
        clock=lambda: moment,
        replay=Replay(capacity=1000),
    )
    token = warrant(own, b"body", moment)
    head = jwt.get_unverified_header(token)
    claims = jwt.decode(token, options={"verify_signature": False})

    def check(data: bytes) -> None:
        text = data.decode("latin-1")
        if data.startswith(_SIGNED):
            try:
                signed = json.loads(data)
                text = "Bearer " + jwt.encode(
                    signed, own.key, algorithm="ES256", headers={"x5c": head["x5c"]}
                )
            except (ValueError, TypeError, RecursionError, jwt.PyJWTError):
                return
        try:
            found = verifier.verify(text)
        except UnauthenticatedError:
            return
        assert found.gateway == own.name
        assert 1 <= len(found.sha256) <= 128

    seeds = (f"Bearer {token}".encode(), b"Bearer x", b"", json.dumps(claims).encode())
    return Target(seeds, mutate_text, check)
