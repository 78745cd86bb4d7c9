"""The dashboard's files and the interactive page of the API, for readers who signed in."""

from importlib.resources import files
from pathlib import Path
from typing import Final

from fastapi import APIRouter
from starlette.responses import FileResponse, RedirectResponse, Response
from starlette.types import Receive, Scope, Send

from eskin.runtime.http_server.problems import ProblemError
from eskin_cloud import access
from eskin_cloud.api.dependencies import CloudState, MaybePrincipal, Unproven
from eskin_cloud.api.middleware.headers import CONTENT_POLICY

router = APIRouter(include_in_schema=False)

_IMMUTABLE: Final = "public, max-age=31536000, immutable"
_DOCS_PAGE: Final = Path(str(files("eskin_cloud.api"))) / "docs_page"
_SWAGGER_UI: Final = Path(str(files("fastapi_offline"))) / "static"
_DOCS_POLICY: Final = f"{CONTENT_POLICY}; img-src 'self' data:"
"""Swagger UI's style sheet holds its icons."""
_NOT_BUILT: Final = b"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>eskin</title>
<link rel="stylesheet" href="/login.css"></head>
<body><main><h1>The dashboard is not built</h1>
<p>The cloud runs, but its dashboard was not built into this installation. Build it
(<code>npm run build</code> in <code>cloud/dashboard</code>), then load this page again.
The REST interface under <code>/api/v1</code> works without it.</p></main></body></html>
"""


@router.get("/{path:path}")
def get_file(cloud: CloudState, caller: MaybePrincipal, path: str) -> Response:
    """A file of the dashboard or of ``/docs``; browsers without a session go to the login page."""
    is_page = not path.startswith("api/")
    if isinstance(caller, Unproven):
        if is_page:
            return RedirectResponse("/login", 303, headers={"Cache-Control": "no-store"})
        raise caller.refusal
    if access.Scope.READ not in caller.holder.scopes:
        raise ProblemError(
            403, "this session lacks the scope read; ask for one that has it", kind="missing-scope"
        )
    if not path and not (cloud.dashboard / "index.html").is_file():
        return Response(_NOT_BUILT, 503, media_type="text/html")
    file = _find_page(cloud.dashboard, path) if is_page else None
    if file is None:
        raise ProblemError(404, f"there is nothing at /{path}; /openapi.json lists what there is")
    caching = _IMMUTABLE if path.startswith("assets/") else "no-cache"
    policy = _DOCS_POLICY if path == "docs" else CONTENT_POLICY
    headers = {"Cache-Control": caching, "Content-Security-Policy": policy}
    return _WholeFile(file, headers=headers)


class _WholeFile(FileResponse):
    """A file, whatever range is asked for: a server may ignore ranges (RFC 9110, section 14.2)."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer with all of it; Starlette would refuse an invalid range in plain text."""
        headers = [each for each in scope["headers"] if each[0] != b"range"]
        await super().__call__({**scope, "headers": headers}, receive, send)


def _find_page(dashboard: Path, path: str) -> Path | None:
    if path == "docs":
        return _DOCS_PAGE / "index.html"
    if path.startswith("docs/"):
        name = path.removeprefix("docs/")
        return _find(_DOCS_PAGE, name) or _find(_SWAGGER_UI, name)
    return _find(dashboard, path or "index.html")


def _find(folder: Path, path: str) -> Path | None:
    """A file inside the folder; ``None`` where the path leads out of it."""
    try:
        file = (folder / path).resolve()
        return file if file.is_relative_to(folder.resolve()) and file.is_file() else None
    except (OSError, ValueError):  # a name that no file can have
        return None
