"""Dependencies of routes: the shared state, and the caller's identity.

What does not wait for the store is asynchronous, so that no thread is woken for it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from typing import Annotated, Final
from urllib.parse import urlsplit

from fastapi import Depends, Request, WebSocket
from fastapi.security import APIKeyCookie, HTTPAuthorizationCredentials, HTTPBearer
from fastapi.security.utils import get_authorization_scheme_param
from sqlalchemy import Connection
from starlette.requests import HTTPConnection

from eskin.runtime.http_server.connection_limits import CALLER
from eskin.runtime.http_server.problems import ProblemError
from eskin_cloud.access import Actor, Principal, Scope, find_session, find_token
from eskin_cloud.api.middleware.answer import recheck
from eskin_cloud.app_state import AppState
from eskin_cloud.query.listing import sealed_nodes

_COOKIE: Final = "eskin_session"
_LONGEST_SECRET: Final = 512

_bearer = HTTPBearer(
    auto_error=False, description="a token; which scope a route needs stands in docs/rest.md"
)
_documented_cookie = APIKeyCookie(
    name=_COOKIE,
    auto_error=False,
    description="a session, from /login; the name has a prefix over HTTPS, and ends in the port",
)


class Unproven(StrEnum):
    """Why a caller is not known; its text says so."""

    MISSING = "the request has neither a token nor a session"
    UNKNOWN = "the token or session is not known here, or has expired"

    @property
    def refusal(self) -> ProblemError:
        """How the caller is refused."""
        return ProblemError(401, f"{self}; send Authorization: Bearer TOKEN, or sign in")


@dataclass(frozen=True, slots=True)
class Access:
    """The caller.

    Attributes:
        holder: The caller's name and scopes.
        address: From where.
        lasts: Whether the caller still may; long answers ask again.
        opened: Sites and subjects whose sealed messages were opened for this request.
    """

    holder: Principal
    address: str
    lasts: Callable[[], bool]
    opened: set[tuple[str, str]] = field(default_factory=set)

    def require(self) -> None:
        """Check again.

        Raises:
            ProblemError: The token or session is no longer valid.
        """
        if not self.lasts():
            raise ProblemError(401, "the token was revoked while it was used", kind="revoked-token")

    def uncounted(self, connection: Connection, names: Sequence[str] | None = None) -> set[str]:
        """Those of these nodes, or of all, whose messages the caller must not be able to count.

        They have a biometric channel, and the caller lacks its scope: a peak is a heartbeat.
        """
        if Scope.BIOMETRIC in self.holder.scopes:
            return set()
        return sealed_nodes(connection, names)

    @property
    def actor(self) -> Actor:
        """For the audit log."""
        return Actor(self.holder.name, self.address)


def address_of(request: HTTPConnection) -> str:
    """The caller's address; empty where the server does not know it."""
    return "" if request.client is None else request.client.host.removeprefix("::ffff:")


async def the_cloud(request: HTTPConnection) -> AppState:
    """The shared state."""
    cloud: AppState = request.app.state.cloud
    return cloud


CloudState = Annotated[AppState, Depends(the_cloud)]


def cookie_name(cloud: AppState) -> str:
    """Name of the session's cookie, which belongs to this cloud alone.

    Browsers keep cookies by host, whatever the port (RFC 6265, section 8.5), so two clouds on one
    host need two names. ``__Host-`` keeps other hosts of the domain from setting it (RFC 6265bis).
    """
    prefix = "__Host-" if cloud.secure else ""
    return f"{prefix}{_COOKIE}_{cloud.settings.people.port}"


async def find_session_cookie(
    cloud: CloudState, request: Request, _: Annotated[str | None, Depends(_documented_cookie)]
) -> str | None:
    """The session's secret that a browser sends, if it does."""
    return request.cookies.get(cookie_name(cloud))


SessionCookie = Annotated[str | None, Depends(find_session_cookie)]


def find_access(
    cloud: CloudState,
    request: Request,
    bearer: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)],
    session: SessionCookie,
) -> Access | Unproven:
    """The caller, by bearer token or else by session."""
    return _find(cloud, request, None if bearer is None else bearer.credentials, session)


def _find(
    cloud: AppState, request: HTTPConnection, token: str | None, session: str | None
) -> Access | Unproven:
    def holder() -> Principal | None:
        if token is not None:
            return find_token(cloud.store, token[:_LONGEST_SECRET])
        if session is not None:
            return find_session(cloud.store, session[:_LONGEST_SECRET])
        return None

    found = holder()
    if found is None:
        return Unproven.MISSING if token is None and session is None else Unproven.UNKNOWN
    opened: set[tuple[str, str]] = set()
    # The connection counts for its caller, and no more for an address that many may share.
    if caller := request.scope.get("extensions", {}).get(CALLER):
        caller["identify"](session if token is None else token)
    access = Access(found, address_of(request), lambda: holder() is not None, opened)
    recheck(request, access.require)
    recheck(request, partial(_require_unerased, cloud, opened), each_piece_with=opened)
    return access


def _require_unerased(cloud: AppState, opened: set[tuple[str, str]]) -> None:
    """Check that no person whose messages were opened for a request was erased since.

    Raises:
        ErasedError: One was.
    """
    with cloud.store.read() as connection:
        cloud.key_access.require_unerased(connection, tuple(opened))


MaybePrincipal = Annotated[Access | Unproven, Depends(find_access)]


async def require_read(caller: MaybePrincipal) -> Access:
    """Require a caller who may read.

    Raises:
        ProblemError: 401 without proof, 403 without the scope.
    """
    return _require(caller, Scope.READ)


async def require_operate(request: Request, caller: MaybePrincipal) -> Access:
    """Require a caller who may command nodes; browsers only from our own pages.

    Raises:
        ProblemError: 401 without proof, 403 without the scope, or from another site.
    """
    require_same_site(request)
    return _require(caller, Scope.OPERATE)


async def require_admin(request: Request, caller: MaybePrincipal) -> Access:
    """Require a caller who may administer access; browsers only from our own pages.

    Raises:
        ProblemError: 401 without proof, 403 without the scope, or from another site.
    """
    require_same_site(request)
    return _require(caller, Scope.ADMIN)


def require_viewer(cloud: CloudState, websocket: WebSocket) -> Access:
    """Require a caller who may read, on a WebSocket; with a session from our own pages only.

    Browsers send the session's cookie with a WebSocket that a page of any site opens, and let that
    page read what comes. They name the page's origin (RFC 6455, section 10.2).

    Raises:
        ProblemError: 401 without proof, 403 without the scope, or from another site.
    """
    scheme, token = get_authorization_scheme_param(websocket.headers.get("authorization"))
    if scheme.lower() == "bearer" and token:
        return _require(_find(cloud, websocket, token, None), Scope.READ)
    session = websocket.cookies.get(cookie_name(cloud))
    origin, host = websocket.headers.get("origin"), websocket.headers.get("host", "")
    if session is not None and (origin is None or _host_of(origin) != host):
        raise _cross_site()
    return _require(_find(cloud, websocket, None, session), Scope.READ)


def require_same_site(request: Request) -> None:
    """Refuse what other sites have a browser send.

    Browsers say where a request comes from: by ``Sec-Fetch-Site``, older ones by ``Origin``.

    Raises:
        ProblemError: It comes from another site.
    """
    site, origin = request.headers.get("sec-fetch-site"), request.headers.get("origin")
    if site is not None:
        own = site in {"same-origin", "none"}
    else:
        own = origin is None or _host_of(origin) == request.headers.get("host", "")
    if not own:
        raise _cross_site()


def _cross_site() -> ProblemError:
    return ProblemError(
        403,
        "another site had this sent; do it on this page, or with a token",
        kind="cross-site-request",
    )


def _host_of(origin: str) -> str | None:
    try:
        return urlsplit(origin).netloc
    except ValueError:
        return None


def _require(caller: Access | Unproven, scope: Scope) -> Access:
    if isinstance(caller, Unproven):
        raise caller.refusal
    if scope not in caller.holder.scopes:
        raise ProblemError(
            403,
            f"this token lacks the scope {scope}; ask for one that has it",
            kind="missing-scope",
        )
    return caller


async def require_biometric(caller: MaybePrincipal) -> Access:
    """Require a caller who may read biometric channels.

    Raises:
        ProblemError: 401 without proof, 403 without the scope.
    """
    return _require(_require(caller, Scope.READ), Scope.BIOMETRIC)


BiometricReader = Annotated[Access, Depends(require_biometric)]
Reader = Annotated[Access, Depends(require_read)]
Viewer = Annotated[Access, Depends(require_viewer)]
Operator = Annotated[Access, Depends(require_operate)]
Administrator = Annotated[Access, Depends(require_admin)]
