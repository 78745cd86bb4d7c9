"""Errors as problem details (RFC 9457): what happened, and what to do; never a traceback.

Each error's ``type`` is ``/problems/NAME``: clients match it, and the server answers it with a
page that says what to do.
"""

from __future__ import annotations

import html
import json
import logging
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, Final

from fastapi.exceptions import (
    RequestValidationError,
    ValidationException,
    WebSocketRequestValidationError,
)
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response

from eskin.errors import EskinError, shown, unprefixed

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
_TITLES: Final = {
    413: "Content Too Large",
    414: "URI Too Long",
    422: "Unprocessable Content",
}
"""Which Python 3.11 knows by older names (RFC 9110, section 15.5)."""
_SCHEMA: Final = {
    "type": "object",
    "required": ["type", "title", "status", "detail", "instance"],
    "properties": {
        "type": {"type": "string", "format": "uri-reference", "examples": ["/problems/not-found"]},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string"},
        "instance": {"type": "string"},
    },
}
_REMEDIES: Final = {
    400: "The request is not valid HTTP, or its body ended early. Correct it, and send it again.",
    401: "Send a valid token as Authorization: Bearer TOKEN, or sign in.",
    403: "The client may not do this. Use a token or a certificate that permits it.",
    404: "Nothing is at this path. Check the path and the names in it.",
    405: "This path has no such method. The Allow header lists those that it has.",
    406: "No offered media type is acceptable. Change the Accept header.",
    408: "The request took too long to arrive. Send it again, faster.",
    409: "The request conflicts with the present state. Read the state, then decide.",
    410: "The data existed, and are gone. Do not retry.",
    411: "Send a Content-Length header.",
    413: "The body is too large. Send less at once.",
    414: "The URL is too long. Send fewer parameters.",
    415: "Send the body in the media type that the detail names.",
    421: "The Host header names another server. Use this server's own name.",
    422: "A parameter or the body is not valid. The detail names it; correct it.",
    429: "Too many requests came from one address. Wait as long as Retry-After says.",
    431: "The header is too large. Send fewer or shorter fields.",
    500: "The server failed. Its log says why; report it to its operator.",
    503: "The server cannot answer now. Retry after the time that Retry-After gives.",
}
"""What a client does about an error that has no name but its status's."""


class ProblemError(EskinError):
    """A request that is refused.

    Attributes:
        status: HTTP status.
        kind: Name of the problem's type; by default the status's.
    """

    def __init__(self, status: int, detail: str, *, kind: str | None = None) -> None:
        super().__init__(detail)
        self.status = status
        self.kind = kind


@dataclass(frozen=True, slots=True)
class Refusal:
    """How errors of one kind are answered.

    Attributes:
        status: HTTP status.
        detail: What the answer says in place of the error's own text.
        kind: Name of the problem's type; by default the status's.
        headers: What the answer's header says besides.
        level: Of the log line; ``NOTSET`` for none.
        limited: Whether the log line waits for `log_refusal`.
    """

    status: int
    detail: str | None = None
    kind: str | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    level: int = logging.NOTSET
    limited: bool = False


_FAULT: Final = Refusal(500, "this is our fault; the server's log has more", level=logging.ERROR)


class Problems:
    """One application's refusals.

    Args:
        refusals: How each kind of error is answered; the first kind that fits counts.
        hint: Where a client finds what the application offers.
        remedies: What a client does about each problem type of the application's own.
    """

    def __init__(
        self,
        refusals: Mapping[type[EskinError], Refusal],
        *,
        hint: str,
        remedies: Mapping[str, str] | None = None,
    ) -> None:
        self._refusals = refusals
        self._hint = hint
        self._remedies = {kind_of(status): text for status, text in _REMEDIES.items()}
        self._remedies |= remedies or {}

    def answer_all(self, app: FastAPI) -> None:
        """Have an application answer every error with problem details, and explain their types."""
        app.add_api_route("/problems/{name}", self.explain, include_in_schema=False)
        app.add_exception_handler(EskinError, self.refuse)
        app.add_exception_handler(RequestValidationError, _on_validation)
        app.add_exception_handler(WebSocketRequestValidationError, _on_validation)
        app.add_exception_handler(HTTPException, self._on_http)
        app.add_exception_handler(ClientDisconnect, _on_disconnect)
        app.add_exception_handler(Exception, self.refuse)

    async def explain(self, name: str) -> Response:
        """The page behind a problem's ``type``: what it is, and what to do."""
        remedy = self._remedies.get(name)
        if remedy is None:
            raise ProblemError(404, f"no problem is named {shown(name)}; {self._hint}")
        title = html.escape(_title_of(name))
        page = (
            f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
            f"</head><body><h1>{title}</h1><p>{html.escape(remedy)}</p></body></html>"
        )
        return Response(page, media_type="text/html")

    def refuse(self, request: Request, error: Exception) -> Response:
        """The refusal of a request that failed by an error."""
        if isinstance(error, ProblemError):
            return problem(request.scope, error.status, str(error), kind=error.kind)
        kinds = self._refusals.items()
        found = next((refusal for kind, refusal in kinds if isinstance(error, kind)), _FAULT)
        reason = str(error) if isinstance(error, EskinError) else f"{type(error).__name__}: {error}"
        if found.limited:
            request.scope[_REASON] = reason
        elif found.level:
            _log(request.scope, found.level, reason)
        return problem(
            request.scope,
            found.status,
            found.detail or reason,
            kind=found.kind,
            headers=found.headers,
        )

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


def kind_of(status: int) -> str:
    """Name of a status's own problem type."""
    return _title(status).lower().replace(" ", "-")


def details(status: int, detail: str, *, instance: str = "", kind: str | None = None) -> bytes:
    """Problem details.

    Args:
        status: HTTP status.
        detail: What happened, and what to do.
        instance: The path that was asked for; empty where it is not known.
        kind: Name of the problem's type; ``None`` where no page explains it: ``about:blank``.
    """
    document = {
        "type": "about:blank" if kind is None else f"/problems/{kind}",
        "title": _title(status) if kind is None else _title_of(kind),
        "status": int(status),
        "detail": detail,
        "instance": instance,
    }
    return json.dumps(document).encode()


def problem(
    scope: Scope,
    status: int,
    detail: str,
    *,
    kind: str | None = None,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """An answer with problem details; their type is the status's own by default."""
    extra = dict(headers or {})
    if status == HTTPStatus.UNAUTHORIZED:
        extra.setdefault("WWW-Authenticate", "Bearer")
    if status == HTTPStatus.SERVICE_UNAVAILABLE:
        extra.setdefault("Retry-After", str(_RETRY_S))
    # `Request.url` fails where host or query cannot be read.
    body = details(status, detail, instance=scope["path"], kind=kind or kind_of(status))
    return Response(body, status, extra, MEDIA_TYPE)


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
    assert isinstance(error, ValidationException)  # noqa: S101 - what it is registered for
    kind = request.headers.get("content-type")
    text = "; ".join(_fault_text(fault, kind) for fault in error.errors())
    return problem(request.scope, 422, text[:_LONGEST_DETAIL])


def _fault_text(fault: dict[str, Any], media_type: str | None) -> str:
    if fault["type"] == "json_invalid":
        reason = fault["ctx"]["error"]
        return f"body: no JSON from position {fault['loc'][1]} on: {reason}; send all of a document"
    if fault["loc"] == ("body",) and isinstance(fault.get("input"), bytes):
        # The framework reads no body of another type.
        found = "is missing" if media_type is None else f"is {shown(media_type)}"
        return f"Content-Type {found}; send the body as application/json"
    name = ".".join(str(part) for part in fault["loc"][1:]) or "request"
    name = name[:_LONGEST_NAME].encode("ascii", "backslashreplace").decode()
    if fault["type"] == "extra_forbidden":
        return f"{name}: no such parameter; check its spelling"
    if fault["type"] == "missing":
        return f"{name}: is missing; add it to the {fault['loc'][0]}"
    return f"{name}: {shown(fault.get('input'))} is not allowed: {unprefixed(fault['msg'])}"


def _title_of(kind: str) -> str:
    return kind.replace("-", " ").title()


def _title(status: int) -> str:
    return _TITLES.get(status) or HTTPStatus(status).phrase
