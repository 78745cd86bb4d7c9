"""Refusals as problem details (RFC 9457): what happened, and what to do; never a traceback."""

from __future__ import annotations

import logging
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, Final

import orjson
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response

from cloud.commands.errors import BacklogError
from cloud.ingest.errors import (
    BatchTooLargeError,
    BatchTypeError,
    IngestError,
    MalformedBatchError,
    UntrustedGatewayError,
)
from cloud.privacy.errors import ErasedError
from cloud.query.errors import UnknownPlaceError
from eskin.errors import CommandError, EskinError, QueryError, StoreError, shown

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.requests import Request

log = logging.getLogger(__name__)

MEDIA_TYPE: Final = "application/problem+json"
RETRY_SECONDS: Final = 5
_REFUSAL: Final = "eskin.refusal"
"""Where a request's scope keeps why it is refused, until its limits are known."""
_LONGEST_NAME: Final = 200
"""Of a parameter as refusals show it: who asks may call it anything."""

_STATUSES: Final[tuple[tuple[type[EskinError], int], ...]] = (
    (UnknownPlaceError, 404),
    (QueryError, 422),
    (CommandError, 422),
    (BacklogError, 409),
    (StoreError, 503),
    (UntrustedGatewayError, 403),
    (BatchTooLargeError, 413),
    (BatchTypeError, 415),
    (MalformedBatchError, 422),
    (ErasedError, 410),
)
_TITLES: Final = {413: "Content Too Large", 422: "Unprocessable Content"}
_SCHEMA: Final = {
    "type": "object",
    "required": ["type", "title", "status", "detail", "instance"],
    "properties": {
        "type": {"type": "string"},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string"},
        "instance": {"type": "string"},
    },
}


class ProblemError(EskinError):
    """A request that is refused.

    Attributes:
        status: HTTP status.
        headers: What the answer's header says besides.
    """

    def __init__(self, status: int, detail: str, *, headers: dict[str, str] | None = None) -> None:
        super().__init__(detail)
        self.status = status
        self.headers = headers or {}


def documented(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Refusals of a route, for its OpenAPI description."""
    content = {MEDIA_TYPE: {"schema": _SCHEMA}}
    return {status: {"description": _title(status), "content": content} for status in statuses}


def problem(
    request: Request, status: int, detail: str, *, headers: dict[str, str] | None = None
) -> Response:
    """An answer with problem details."""
    body = {
        "type": "about:blank",
        "title": _title(status),
        "status": status,
        "detail": detail,
        "instance": _path(request),
    }
    extra = dict(headers or {})
    if status == HTTPStatus.UNAUTHORIZED:
        extra.setdefault("WWW-Authenticate", "Bearer")
    if status == HTTPStatus.SERVICE_UNAVAILABLE:
        extra.setdefault("Retry-After", str(RETRY_SECONDS))
    return Response(orjson.dumps(body), status, extra, MEDIA_TYPE)


def log_refusal(request: Request) -> None:
    """Log that a gateway is refused; after its address was counted, so that a flood is silent."""
    reason = request.scope.get(_REFUSAL)
    if reason is not None:
        log.warning("gateway refused: path=%r reason=%s", _path(request), reason)


def answer_problems(app: FastAPI) -> None:
    """Have an application answer every refusal with problem details."""
    app.add_exception_handler(ProblemError, _on_problem)
    app.add_exception_handler(EskinError, _on_eskin)
    app.add_exception_handler(RequestValidationError, _on_validation)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(ClientDisconnect, _on_disconnect)
    app.add_exception_handler(Exception, _on_fault)


def refuse(request: Request, error: EskinError) -> Response:
    """The refusal of a request that failed by an error of ours."""
    return (_on_problem if isinstance(error, ProblemError) else _on_eskin)(request, error)


def _on_problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, ProblemError)  # noqa: S101 - what it is registered for
    return problem(request, error.status, str(error), headers=error.headers)


def _on_disconnect(request: Request, error: Exception) -> Response:
    """Whoever sent half a body is gone, and nobody hears the answer."""
    del error
    log.info("client left in the middle of its body: path=%s", _path(request))
    return problem(request, 400, "the body ended too early")


def _on_eskin(request: Request, error: Exception) -> Response:
    status = next((status for kind, status in _STATUSES if isinstance(error, kind)), 500)
    if status >= HTTPStatus.INTERNAL_SERVER_ERROR:
        log.error("request failed: path=%s reason=%s", _path(request), error)
    elif isinstance(error, UntrustedGatewayError):
        request.scope[_REFUSAL] = str(error)
    elif isinstance(error, IngestError):
        log.warning("batch refused: status=%d reason=%s", status, error)
    if status == HTTPStatus.INTERNAL_SERVER_ERROR:
        return problem(request, status, "this is our fault; the cloud's log tells more")
    # A renewed certificate is shown by another connection.
    headers = {"Connection": "close"} if isinstance(error, UntrustedGatewayError) else None
    return problem(request, status, str(error), headers=headers)


def _on_validation(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)  # noqa: S101 - what it is registered for
    return problem(request, 422, "; ".join(_said(fault) for fault in error.errors()))


def _said(fault: dict[str, Any]) -> str:
    name = ".".join(str(part) for part in fault["loc"][1:]) or "request"
    name = name[:_LONGEST_NAME].encode("ascii", "backslashreplace").decode()
    if fault["type"] == "extra_forbidden":
        return f"{name}: no such parameter; check its spelling"
    if fault["type"] == "missing":
        return f"{name}: is missing"
    return f"{name}: {shown(fault.get('input'))} is not allowed: {fault['msg']}"


def _on_http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)  # noqa: S101 - what it is registered for
    details = {
        404: f"there is nothing at {_path(request)}; /openapi.json lists what there is",
        405: f"{request.method} is not possible here; see the Allow header",
    }
    detail = details.get(error.status_code, str(error.detail))
    headers = dict(error.headers or {})
    return problem(request, error.status_code, detail, headers=headers)


def _on_fault(request: Request, error: Exception) -> Response:
    log.error("request failed: path=%s reason=%s: %s", _path(request), type(error).__name__, error)
    return problem(request, 500, "this is our fault; the cloud's log tells more")


def _path(request: Request) -> str:
    """As it was asked for; `Request.url` fails where host or query are no good."""
    path: str = request.scope["path"]
    return path


def _title(status: int) -> str:
    return _TITLES.get(status) or HTTPStatus(status).phrase
