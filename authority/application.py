"""HTTPS face of the CA service.

``POST /enrol`` takes a token and a certificate request; everything else is public and read only.
All run on the one event loop, so ledger and tokens change one request at a time.
"""

import logging
from datetime import timedelta
from typing import Annotated

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec
from fastapi import FastAPI, HTTPException, Path, Request, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field

from authority.tokens import Tokens
from eskin.errors import IdentityError
from eskin.identity import Authority, IdentityKind
from eskin.identity.certificates import pem

log = logging.getLogger(__name__)

_PEM = "application/x-pem-file"


class EnrolmentRequest(BaseModel):
    """Body of ``POST /enrol``."""

    model_config = ConfigDict(extra="forbid")

    token: str = Field(min_length=1, max_length=200, description="one-time enrolment token")
    request: str = Field(max_length=8000, description="PKCS #10 request, PEM (RFC 2986)")


class EnrolmentAnswer(BaseModel):
    """Answer of ``POST /enrol``."""

    chain: str = Field(description="the certificate, then the issuing CA's, PEM")
    root: str = Field(description="the root CA's certificate, PEM")


def create_application(authority: Authority, tokens: Tokens, *, lifetime: timedelta) -> FastAPI:
    """Build the application over an opened CA."""
    app = FastAPI(title="eskin certificate authority", docs_url=None, redoc_url=None)

    @app.exception_handler(IdentityError)
    async def refuse(_: Request, error: IdentityError) -> JSONResponse:
        log.warning("refused: %s", error)
        return JSONResponse(
            {"type": "about:blank", "title": "Forbidden", "status": 403, "detail": str(error)},
            status_code=403,
            media_type="application/problem+json",
        )

    @app.post("/enrol")
    async def enrol(body: EnrolmentRequest) -> EnrolmentAnswer:
        key = _requested_key(body.request)
        enrolment = tokens.redeem(body.token, _der(key))
        chain = authority.issue(
            enrolment.kind, enrolment.name, key, hosts=enrolment.hosts, lifetime=lifetime
        )
        log.info("enrolled: kind=%s name=%s", enrolment.kind, enrolment.name)
        return EnrolmentAnswer(chain=pem(chain).decode(), root=pem([authority.root]).decode())

    @app.get("/certificates/{name}")
    async def certificate(name: Annotated[str, Path(max_length=100)]) -> Response:
        chain = authority.latest(name)
        if chain is None:
            raise HTTPException(404, f"no certificate was issued to {name!r} yet")
        return Response(pem(chain), media_type=_PEM)

    @app.get("/anchors/{kind}")
    async def anchor(kind: IdentityKind) -> Response:
        return Response(authority.anchor_file(kind).read_bytes(), media_type=_PEM)

    @app.get("/revocations/{kind}")
    async def revocations(kind: IdentityKind) -> Response:
        return Response(authority.write_revocations(kind).read_bytes(), media_type=_PEM)

    @app.get("/healthz")
    async def health() -> dict[str, str]:
        return {"status": "ok"}

    return app


def _requested_key(text: str) -> ec.EllipticCurvePublicKey:
    try:
        request = x509.load_pem_x509_csr(text.encode())
        genuine = request.is_signature_valid
    except ValueError as error:
        raise IdentityError(f"no PKCS #10 request: {error}") from error
    key = request.public_key()
    if not genuine:
        raise IdentityError("the request is not signed by the key that it holds")
    if not isinstance(key, ec.EllipticCurvePublicKey) or not isinstance(key.curve, ec.SECP256R1):
        raise IdentityError("the requested key is not on the curve P-256")
    return key


def _der(key: ec.EllipticCurvePublicKey) -> bytes:
    return key.public_bytes(
        serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    )
