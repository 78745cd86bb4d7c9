"""Refusals as problem details (RFC 9457): what happened, and what to do; never a traceback."""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, Final

from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response

from eskin.errors import EskinError, shown

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fastapi import FastAPI
    from starlette.requests import Request
    from starlette.types import Scope

log = logging.getLogger(__name__)

MEDIA_TYPE: Final = "application/problem+json"
_RETRY_S: Final = 5
_REASON: Final = "eskin.refusal"
"""Where a request's scope keeps why it is refused, until its limits are known."""
_LONGEST_NAME: Final = 200
"""Of a parameter as refusals show it: the client may call it anything."""
_LONGEST_DETAIL: Final = 1000
_TITLES: Final = {413: "Content Too Large", 422: "Unprocessable Content"}
"""Which Python 3.11 knows by older names (RFC 9110, sections 15.5.14 and 15.5.21)."""
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


@dataclass(frozen=True, slots=True)
class Refusal:
    """How errors of one kind are answered.

    Attributes:
        status: HTTP status.
        detail: What is told in place of the error's own words.
        headers: What the answer's header says besides.
        level: Of the log line; ``NOTSET`` for none.
        limited: Whether the log line waits for `log_refusal`.
    """

    status: int
    detail: str | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    level: int = logging.NOTSET
    limited: bool = False


_FAULT: Final = Refusal(500, "this is our fault; the server's log tells more", level=logging.ERROR)


class Problems:
    """One application's refusals.

    Args:
        refusals: How each kind of error is answered; the first kind that fits counts.
        hint: Where a client finds what the application offers.
    """

    def __init__(self, refusals: Mapping[type[EskinError], Refusal], *, hint: str) -> None:
        self._refusals = refusals
        self._hint = hint

    def answer_all(self, app: FastAPI) -> None:
        """Have an application answer every refusal with problem details."""
        app.add_exception_handler(EskinError, self.refuse)
        app.add_exception_handler(RequestValidationError, _on_validation)
        app.add_exception_handler(HTTPException, self._on_http)
        app.add_exception_handler(ClientDisconnect, _on_disconnect)
        app.add_exception_handler(Exception, self.refuse)

    def refuse(self, request: Request, error: Exception) -> Response:
        """The refusal of a request that failed by an error."""
        if isinstance(error, ProblemError):
            return problem(request.scope, error.status, str(error), headers=error.headers)
        kinds = self._refusals.items()
        found = next((refusal for kind, refusal in kinds if isinstance(error, kind)), _FAULT)
        reason = str(error) if isinstance(error, EskinError) else f"{type(error).__name__}: {error}"
        if found.limited:
            request.scope[_REASON] = reason
        elif found.level:
            _log(request.scope, found.level, reason)
        return problem(request.scope, found.status, found.detail or reason, headers=found.headers)

    def _on_http(self, request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)  # noqa: S101 - what it is registered for
        detail = str(error.detail)
        if detail == HTTPStatus(error.status_code).phrase:  # the framework's own
            detail = f"{request.method} of this path is not offered; {self._hint}"
        return problem(request.scope, error.status_code, detail, headers=error.headers)


def documented(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Refusals of a route, for its OpenAPI description."""
    content = {MEDIA_TYPE: {"schema": _SCHEMA}}
    return {status: {"description": _title(status), "content": content} for status in statuses}


def details(status: int, detail: str, *, instance: str = "") -> bytes:
    """Problem details, of type ``about:blank``.

    Args:
        status: HTTP status.
        detail: What happened, and what to do.
        instance: The path that was asked for; empty where it is not known.
    """
    said = {
        "type": "about:blank",
        "title": _title(status),
        "status": int(status),
        "detail": detail,
        "instance": instance,
    }
    return json.dumps(said).encode()


def problem(
    scope: Scope, status: int, detail: str, *, headers: Mapping[str, str] | None = None
) -> Response:
    """An answer with problem details."""
    extra = dict(headers or {})
    if status == HTTPStatus.UNAUTHORIZED:
        extra.setdefault("WWW-Authenticate", "Bearer")
    if status == HTTPStatus.SERVICE_UNAVAILABLE:
        extra.setdefault("Retry-After", str(_RETRY_S))
    # `Request.url` fails where host or query cannot be read.
    return Response(details(status, detail, instance=scope["path"]), status, extra, MEDIA_TYPE)


def log_refusal(scope: Scope) -> None:
    """Log a refusal; after its address was counted, so that a flood is silent."""
    reason = scope.get(_REASON)
    if reason is not None:
        _log(scope, logging.WARNING, reason)


def _log(scope: Scope, level: int, reason: str) -> None:
    log.log(level, "request refused: path=%r reason=%s", scope["path"], reason)


def _on_disconnect(request: Request, error: Exception) -> Response:
    """The client sent half a body and is gone; it reads no answer."""
    del error
    log.info("client left in the middle of its body: path=%r", request.scope["path"])
    return problem(request.scope, 400, "the body ended too early")


def _on_validation(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)  # noqa: S101 - what it is registered for
    told = "; ".join(_told(fault) for fault in error.errors())
    return problem(request.scope, 422, told[:_LONGEST_DETAIL])


def _told(fault: dict[str, Any]) -> str:
    name = ".".join(str(part) for part in fault["loc"][1:]) or "request"
    name = name[:_LONGEST_NAME].encode("ascii", "backslashreplace").decode()
    if fault["type"] == "extra_forbidden":
        return f"{name}: no such parameter; check its spelling"
    if fault["type"] == "missing":
        return f"{name}: is missing"
    return f"{name}: {shown(fault.get('input'))} is not allowed: {fault['msg']}"


def _title(status: int) -> str:
    return _TITLES.get(status) or HTTPStatus(status).phrase
