"""Signing in by one-time link or token, and out."""

import asyncio
from typing import Annotated, Final
from urllib.parse import parse_qs

from fastapi import APIRouter, Query, Request
from starlette.responses import RedirectResponse, Response

from eskin.runtime.http_server.problems import ProblemError
from eskin.wire.timestamp import SECOND
from eskin_cloud.access import close_session, open_session, redeem_login_code, refuse_session
from eskin_cloud.api.dependencies import (
    CloudState,
    SessionCookie,
    address_of,
    cookie_name,
    require_same_site,
)
from eskin_cloud.api.login_page import login_page, login_style
from eskin_cloud.app_state import AppState

router = APIRouter(include_in_schema=False)

_FORM: Final = "application/x-www-form-urlencoded"
_LONGEST_FORM: Final = 4096
_LONGEST_SECRET: Final = 512


@router.get("/login")
async def get_login(
    cloud: CloudState,
    request: Request,
    code: Annotated[str | None, Query(max_length=_LONGEST_SECRET)] = None,
) -> Response:
    """The form; with a one-time code, straight to the dashboard."""
    if code is None:
        return _page("", 200)
    lifetime, address = _lifetime(cloud), address_of(request)
    redeemed = redeem_login_code(cloud.store, code, lifetime=lifetime, address=address)
    session = await asyncio.wrap_future(redeemed)
    if session is None:
        reason = "This link was used already, or is too old. Ask for a new one."
        return await _refused(cloud, address, reason)
    return _signed_in(cloud, session)


@router.post("/login")
async def post_login(cloud: CloudState, request: Request) -> Response:
    """Take the form's token."""
    require_same_site(request)
    token = await _read_token(request)
    address = address_of(request)
    opened = await asyncio.to_thread(
        open_session, cloud.store, token, lifetime=_lifetime(cloud), address=address
    )
    if opened is None:
        reason = "This token is unknown, expired or revoked."
        return await _refused(cloud, address, reason)
    return _signed_in(cloud, await asyncio.wrap_future(opened))


@router.post("/logout")
async def post_logout(
    cloud: CloudState,
    request: Request,
    session: SessionCookie,
) -> Response:
    """End the session."""
    require_same_site(request)
    if session is not None:
        address = address_of(request)
        closed = close_session(cloud.store, session[:_LONGEST_SECRET], address=address)
        await asyncio.wrap_future(closed)
    answer = RedirectResponse("/login", 303)
    answer.delete_cookie(cookie_name(cloud), httponly=True, samesite="strict", secure=cloud.secure)
    return answer


@router.get("/login.css")
async def get_style() -> Response:
    """The page's style sheet."""
    headers = {"Cache-Control": "no-cache"}
    return Response(login_style(), media_type="text/css", headers=headers)


async def _read_token(request: Request) -> str:
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != _FORM:
        raise ProblemError(415, f"Content-Type is {kind!r}; send {_FORM}")
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > _LONGEST_FORM:
            raise ProblemError(413, f"the form is longer than {_LONGEST_FORM} bytes")
    fields = parse_qs(body.decode("latin-1"))
    return fields.get("token", [""])[0].strip()[:_LONGEST_SECRET]


async def _refused(cloud: AppState, address: str, reason: str) -> Response:
    """Refuse a sign-in, and audit it up to a rate."""
    if await cloud.sign_ins.take(address):
        await asyncio.wrap_future(refuse_session(cloud.store, address=address))
    return _page(reason, 401)


def _signed_in(cloud: AppState, session: str) -> Response:
    answer = RedirectResponse("/", 303)
    answer.set_cookie(
        cookie_name(cloud),
        session,
        max_age=_lifetime(cloud) // SECOND,
        httponly=True,
        samesite="strict",
        secure=cloud.secure,
    )
    return answer


def _lifetime(cloud: AppState) -> int:
    return int(cloud.settings.access.session_hours * 3600 * SECOND)


def _page(message: str, status: int) -> Response:
    return Response(login_page(message), status, media_type="text/html")
