"""What routes ask for: the shared state, and proof of who asks."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Final

from fastapi import Depends, Request
from fastapi.security import APIKeyCookie, HTTPAuthorizationCredentials, HTTPBearer

from cloud.access import Scope, find_session, find_token
from cloud.problems import ProblemError
from cloud.state import Cloud

COOKIE: Final = "eskin_session"
_LONGEST_SECRET: Final = 512

_bearer = HTTPBearer(auto_error=False, description="a token with scope read")
_cookie = APIKeyCookie(name=COOKIE, auto_error=False, description="a session, from /login")


@dataclass(frozen=True, slots=True)
class Access:
    """Who asks.

    Attributes:
        scopes: What they may do.
        lasts: Whether they still may; asked again by what goes on for long.
    """

    scopes: frozenset[Scope]
    lasts: Callable[[], bool]


def the_cloud(request: Request) -> Cloud:
    """The shared state."""
    cloud: Cloud = request.app.state.cloud
    return cloud


CloudState = Annotated[Cloud, Depends(the_cloud)]


def find_access(
    cloud: CloudState,
    bearer: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)],
    session: Annotated[str | None, Depends(_cookie)],
) -> Access | None:
    """Who asks, by bearer token or else by session; ``None`` if it is nobody."""

    def scopes() -> frozenset[Scope] | None:
        if bearer is not None:
            return find_token(cloud.store, bearer.credentials[:_LONGEST_SECRET])
        if session is not None:
            return find_session(cloud.store, session[:_LONGEST_SECRET])
        return None

    found = scopes()
    return None if found is None else Access(found, lambda: scopes() is not None)


Visitor = Annotated[Access | None, Depends(find_access)]


def require_read(visitor: Visitor) -> Access:
    """Whoever may read.

    Raises:
        ProblemError: 401 without proof, 403 without the scope.
    """
    if visitor is None:
        raise ProblemError(
            401, "a token is missing or no more good; send Authorization: Bearer TOKEN, or sign in"
        )
    if Scope.READ not in visitor.scopes:
        raise ProblemError(403, "this token lacks the scope read; ask for one that has it")
    return visitor


Reader = Annotated[Access, Depends(require_read)]
