"""A gateway's JSON Web Token (RFC 7519): ES256, its certificate chain in ``x5c`` (RFC 7515)."""

from __future__ import annotations

import base64
import binascii
import hmac
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import jwt

from cloud.ingest.condition import Condition
from cloud.ingest.errors import UnauthenticatedError
from eskin.errors import IdentityError
from eskin.identity import common_name
from eskin.identity.certificates import public_key
from eskin.moment import SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cryptography import x509
    from sqlalchemy import Connection

    from cloud.ingest.replay import Memory

LONGEST: Final = 60
"""Seconds for which a token may be good."""
_LONGEST_TEXT: Final = 16_384
_AUDIENCE: Final = "eskin-cloud"
"""Whom a gateway makes its tokens for."""
_REQUIRED: Final = ("iss", "aud", "iat", "exp", "jti", "sha256")


@dataclass(frozen=True, slots=True)
class Warrant:
    """What a token proves.

    Attributes:
        gateway: Common name.
        sha256: Hash of the body that it was made for, hexadecimal.
        condition: What the gateway tells of itself, if it does.
        is_first: Whether the token comes for the first time; asked in a transaction, with which it
            is remembered.
    """

    gateway: str
    sha256: str
    condition: Condition | None
    is_first: Callable[[Connection], bool]

    def require_body(self, sha256: str) -> None:
        """Check the hash of the body that came.

        Raises:
            UnauthenticatedError: The token was made for another one.
        """
        if not hmac.compare_digest(self.sha256.encode(), sha256.encode()):
            raise UnauthenticatedError(
                f"the token was made for a body with sha256 {self.sha256!r}, and this one has "
                f"{sha256!r}; make a token for each request"
            )


class Verifier:
    """Checks tokens.

    Args:
        verify_chain: Gives a gateway's certificate from its chain, or raises
            `UntrustedCertificateError`.
        skew: Seconds by which a gateway's clock may differ.
        clock: Gives UTC ns.
        replay: Remembers tokens that were used.
    """

    def __init__(
        self,
        verify_chain: Callable[[Sequence[bytes]], x509.Certificate],
        *,
        skew: float,
        clock: Callable[[], int],
        replay: Memory,
    ) -> None:
        self._verify_chain = verify_chain
        self._skew = skew
        self._clock = clock
        self._replay = replay

    def verify(self, authorization: str | None, *, within: bool = False) -> Warrant:
        """Check an ``Authorization`` header, and that its token was not used before.

        Args:
            authorization: The header.
            within: The caller asks `Warrant.is_first` in its own transaction; what it writes
                there is then all that the token is good for.

        Raises:
            UnauthenticatedError: It proves nothing.
        """
        scheme, _, token = (authorization or "").partition(" ")
        if scheme.lower() != "bearer" or not token or len(token) > _LONGEST_TEXT:
            raise UnauthenticatedError("a gateway's token is missing: Authorization: Bearer JWT")
        try:
            chain = _chain(jwt.get_unverified_header(token))
            leaf = self._verify_chain(chain)
            claims = jwt.decode(
                token,
                key=public_key(leaf),
                algorithms=["ES256"],
                audience=_AUDIENCE,
                # Times are checked below, against our own clock.
                options={
                    "require": list(_REQUIRED),
                    "verify_exp": False,
                    "verify_iat": False,
                    "verify_nbf": False,
                },
            )
        except (jwt.PyJWTError, IdentityError, RecursionError) as error:
            raise UnauthenticatedError(f"the gateway's token is refused: {error}") from error
        name = common_name(leaf)
        now = self._clock() / SECOND
        expires = self._require_claims(claims, name, now)
        condition = Condition.read(claims.get("state"))
        known, until = f"{name} {claims['jti']}", expires + self._skew
        if within:
            is_first = self._replay.within(known, until=until, now=now)
            return Warrant(name, claims["sha256"], condition, is_first)
        if not self._replay.first(known, until=until, now=now):
            raise used_before()
        return Warrant(name, claims["sha256"], condition, lambda _: True)

    def _require_claims(self, claims: dict[str, Any], name: str, now: float) -> float:
        """Check what a token says; gives when it expires, in seconds."""
        if claims["iss"] != name:
            raise UnauthenticatedError(
                f"iss is {claims['iss']!r}, and the certificate is of {name!r}"
            )
        issued, expires = _seconds(claims, "iat"), _seconds(claims, "exp")
        for text in ("jti", "sha256"):
            if type(claims[text]) is not str or not 1 <= len(claims[text]) <= 128:
                raise UnauthenticatedError(f"{text} is no text of 1 to 128 characters")
        if not 0 < expires - issued <= LONGEST:
            raise UnauthenticatedError(
                f"the token is good for {expires - issued:g} s; allowed are {LONGEST} s"
            )
        if issued > now + self._skew or expires < now - self._skew:
            raise UnauthenticatedError(
                f"the token is good from {issued:.0f} to {expires:.0f}, and it is {now:.0f}; "
                "set the gateway's clock"
            )
        return expires


def used_before() -> UnauthenticatedError:
    """Why a token is refused that does not come for the first time."""
    return UnauthenticatedError("the token was used before; make one for each request")


def _chain(header: dict[str, Any]) -> list[bytes]:
    listed = header.get("x5c")
    if not isinstance(listed, list) or not 1 <= len(listed) <= 4:
        raise UnauthenticatedError("the token's header has no x5c with the gateway's chain")
    try:
        return [base64.b64decode(item, validate=True) for item in listed]
    except (binascii.Error, ValueError, TypeError) as error:
        raise UnauthenticatedError(f"x5c is no base64: {error}") from error


def _seconds(claims: dict[str, Any], name: str) -> float:
    value = claims[name]
    if type(value) not in {int, float} or not abs(value) < 2**53:
        raise UnauthenticatedError(f"{name} is no time in seconds since 1970")
    return float(value)
