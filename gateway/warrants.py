"""How the gateway proves to the cloud who it is: a token for each request."""

from __future__ import annotations

import hashlib
import uuid
from base64 import b64encode
from time import time
from typing import TYPE_CHECKING, Final

import jwt

from eskin.errors import SpoolError
from eskin.identity import der

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from eskin.identity import Identity

AUDIENCE: Final = "eskin-cloud"
TOKEN_S: Final = 60


class Warrants:
    """Makes the headers of requests to the cloud.

    Args:
        identity: The gateway's, which signs each request.
        clock: Seconds since 1970.
    """

    def __init__(self, identity: Identity, *, clock: Callable[[], float] = time) -> None:
        self._identity = identity
        self._clock = clock
        self._state: Callable[[], Mapping[str, object]] | None = None

    def tell(self, state: Callable[[], Mapping[str, object]]) -> None:
        """Tell the cloud of the gateway's state with each request from now on."""
        self._state = state

    def take(self, identity: Identity) -> None:
        """Sign with a renewed identity from now on."""
        self._identity = identity

    def headers(self, body: bytes) -> dict[str, str]:
        """Headers for one body in CBOR, with a JWT (ES256) that is good for it alone."""
        now = int(self._clock())
        own = self._identity
        claims = {
            "iss": own.name,
            "aud": AUDIENCE,
            "iat": now,
            "exp": now + TOKEN_S,
            "jti": str(uuid.uuid4()),
            "sha256": hashlib.sha256(body).hexdigest(),
            **self._told(),
        }
        chain = [b64encode(der(part)).decode() for part in own.chain]
        token = jwt.encode(claims, own.key, algorithm="ES256", headers={"x5c": chain})
        return {"Content-Type": "application/cbor", "Authorization": f"Bearer {token}"}

    def _told(self) -> dict[str, object]:
        if self._state is None:
            return {}
        try:
            return {"state": self._state()}
        except SpoolError:  # what cannot be read is told by those who need it, and hinders nobody
            return {}
