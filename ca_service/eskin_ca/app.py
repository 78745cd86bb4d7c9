"""HTTPS face of the CA service.

``POST /enrol`` takes a token and a certificate request, ``POST /renew`` a request that the holder
of a certificate signed; everything else is public and read only. Who is refused is refused on the
event loop, at once; what changes the CA waits for its turn in a thread
(see `eskin_ca.change_queue`).
"""

import base64
import binascii
import logging
from datetime import timedelta
from functools import partial
from typing import Annotated

from fastapi import FastAPI, HTTPException, Path, Response
from pydantic import BaseModel, ConfigDict, Field

from eskin.errors import IdentityError
from eskin.identity import CertificateAuthority, IdentityKind, common_name
from eskin.identity.certificates import pem
from eskin.identity.roots import offered_roots
from eskin_ca.change_queue import ChangeQueue
from eskin_ca.csr import der_of_pem
from eskin_ca.enrolment_service import EnrolmentService
from eskin_ca.problems import PROBLEMS
from eskin_ca.renewal_service import RenewalService
from eskin_ca.tokens import Tokens

log = logging.getLogger(__name__)

_PEM = "application/x-pem-file"


class EnrolmentRequest(BaseModel):
    """Body of ``POST /enrol``."""

    model_config = ConfigDict(extra="forbid")

    token: str = Field(min_length=1, max_length=200, description="one-time enrolment token")
    request: str = Field(max_length=8000, description="PKCS #10 request, PEM (RFC 2986)")


class EnrolmentAnswer(BaseModel):
    """Answer of ``POST /enrol`` and ``POST /renew``."""

    chain: str = Field(description="the certificate, then the issuing CA's, PEM")
    root: str = Field(description="the root CAs' certificates, PEM")


class RenewalRequest(BaseModel):
    """Body of ``POST /renew``."""

    model_config = ConfigDict(extra="forbid")

    signed: str = Field(max_length=16_000, description="COSE_Sign1 of a PKCS #10 request, base64")


def create_application(
    authority: CertificateAuthority, tokens: Tokens, *, lifetime: timedelta, grace: timedelta
) -> FastAPI:
    """Build the application over an opened CA.

    The server may set ``app.state.follow``, which is awaited before a caller gets the
    roots that stand: the service's own certificate must not lead to one that visitors then have
    dropped.
    """
    enrolments = EnrolmentService(authority, tokens, lifetime=lifetime)
    renewals = RenewalService(authority, lifetime=lifetime, grace=grace)
    app = FastAPI(title="eskin certificate authority", docs_url=None, redoc_url=None)
    app.state.follow = _nothing
    change_queue = ChangeQueue(authority.directory)

    PROBLEMS.answer_all(app)

    @app.post("/enrol")
    async def enrol(body: EnrolmentRequest) -> EnrolmentAnswer:
        request = der_of_pem(body.request)
        enrolments.judge(body.token, request)
        chain = await change_queue.do(partial(enrolments.enrol, body.token, request))
        await app.state.follow()
        return EnrolmentAnswer(chain=pem(chain).decode(), root=pem(authority.roots).decode())

    @app.post("/renew")
    async def renew(body: RenewalRequest) -> EnrolmentAnswer:
        signed = _decoded(body.signed)
        renewals.judge(signed)
        chain = await change_queue.do(partial(renewals.renew, signed))
        log.info("renewed: name=%s", common_name(chain[0]))
        await app.state.follow()
        return EnrolmentAnswer(chain=pem(chain).decode(), root=pem(authority.roots).decode())

    _add_public(app, authority, change_queue)
    return app


def _add_public(app: FastAPI, authority: CertificateAuthority, change_queue: ChangeQueue) -> None:
    """Public routes."""

    @app.get("/certificates/{name}")
    async def certificate(name: Annotated[str, Path(max_length=100)]) -> Response:
        chain = authority.latest(name)
        if chain is None:
            raise HTTPException(404, f"no certificate was issued to {name!r} yet that stands")
        return Response(pem(chain), media_type=_PEM)

    @app.get("/anchors/{kind}")
    async def anchor(kind: IdentityKind) -> Response:
        return Response(authority.anchor_file(kind).read_bytes(), media_type=_PEM)

    @app.get("/roots")
    async def roots() -> Response:
        await app.state.follow()
        return Response(offered_roots(authority.directory), media_type=_PEM)

    @app.get("/revocations/{kind}")
    async def revocations(kind: IdentityKind) -> Response:
        if authority.must_refresh(kind):
            await change_queue.do(partial(authority.refresh_revocations, kind))
        return Response(authority.revocations_file(kind).read_bytes(), media_type=_PEM)

    @app.get("/revoked/{kind}")
    async def revoked(kind: IdentityKind) -> dict[str, list[dict[str, str]]]:
        found = [e for e in authority.issued() if e.kind == kind and e.revoked is not None]
        return {"items": [{"name": entry.name, "serial": entry.serial} for entry in found]}

    @app.get("/healthz")
    async def health() -> dict[str, str]:
        return {"status": "ok"}


async def _nothing() -> None:
    """The default: no certificate to watch."""


def _decoded(text: str) -> bytes:
    try:
        return base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError) as error:
        raise IdentityError(f"no base64: {error}") from error
