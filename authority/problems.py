"""Refusals as problem details (RFC 9457)."""

from __future__ import annotations

import logging
from http import HTTPStatus
from typing import TYPE_CHECKING, Final

from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from authority.allowance import TooOftenError
from eskin.errors import AuthorityError, IdentityError, LockedError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fastapi import FastAPI, Request
    from starlette.types import Scope

log = logging.getLogger(__name__)

_LONGEST_DETAIL: Final = 1000
_REFUSAL: Final = "eskin.refusal"
"""Where a request's scope keeps why it is refused, until its limits are known."""
_AGAIN: Final = {"Retry-After": "10"}
"""The request is good, and may come again."""
_TITLES: Final = {422: "Unprocessable Content"}
"""Which Python 3.11 knows by an older name (RFC 9110, section 15.5.21)."""


def problem(status: int, detail: str, *, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """An answer with problem details."""
    title = _TITLES.get(status) or HTTPStatus(status).phrase
    return JSONResponse(
        {"type": "about:blank", "title": title, "status": int(status), "detail": detail},
        status_code=status,
        headers=dict(headers or {}),
        media_type="application/problem+json",
    )


def log_refusal(scope: Scope) -> None:
    """Log a refusal; after its address was counted, so that a flood is silent."""
    reason = scope.get(_REFUSAL)
    if reason is not None:
        log.warning("refused: %s", reason)


def answer_problems(app: FastAPI) -> None:
    """Have an application answer every refusal with problem details."""

    @app.exception_handler(IdentityError)
    async def refuse(request: Request, error: IdentityError) -> JSONResponse:
        request.scope[_REFUSAL] = str(error)
        return problem(403, str(error))

    @app.exception_handler(TooOftenError)
    async def slow_down(_: Request, error: TooOftenError) -> JSONResponse:
        log.warning("refused: %s", error)
        return problem(429, str(error), headers=_AGAIN)

    @app.exception_handler(LockedError)
    async def wait(_: Request, error: LockedError) -> JSONResponse:
        log.warning("not now: %s", error)
        return problem(503, "the CA is being changed; come again", headers=_AGAIN)

    @app.exception_handler(AuthorityError)
    async def fail(_: Request, error: AuthorityError) -> JSONResponse:
        log.error("the CA cannot be used: %s", error)
        said = "the CA cannot be used until its operator has looked at it; come again"
        return problem(503, said, headers=_AGAIN)

    @app.exception_handler(RequestValidationError)
    async def refuse_body(_: Request, error: RequestValidationError) -> JSONResponse:
        faults = "; ".join(f"{fault['loc'][-1]}: {fault['msg']}" for fault in error.errors())
        said = faults[:_LONGEST_DETAIL].encode("ascii", "backslashreplace").decode()
        return problem(422, said)

    @app.exception_handler(HTTPException)
    async def refuse_route(request: Request, error: HTTPException) -> JSONResponse:
        detail = str(error.detail)
        if detail == HTTPStatus(error.status_code).phrase:  # the framework's own
            detail = f"{request.method} of this path is not offered; see docs/pki.md"
        return problem(error.status_code, detail, headers=error.headers)
