"""The applications: one for people, one for gateways, over the same state."""

from http import HTTPStatus
from typing import Any, Final

from fastapi import FastAPI
from starlette.responses import Response

from cloud.broken_off import BrokenOffMiddleware
from cloud.damaged_header import DamagedHeaderMiddleware
from cloud.dependencies import Reader
from cloud.headers import HeadersMiddleware
from cloud.limits import LimitsMiddleware
from cloud.problems import answer_problems
from cloud.rate_limits import RateLimits
from cloud.recheck import RecheckMiddleware
from cloud.routes import (
    audit_log,
    certificates,
    commands,
    comparison,
    confirmed,
    dashboard,
    deliveries,
    events,
    export,
    gateways,
    health,
    ingest,
    live,
    login,
    models,
    nodes,
    notices,
    prediction,
    series,
    storage,
    subjects,
    tokens,
)
from cloud.routes.answers import as_json
from cloud.state import Cloud

API: Final = "/api/v1"
_VERSION: Final = "1"


def people_application(cloud: Cloud) -> FastAPI:
    """REST, live stream and dashboard; all but health and login needs a token or a session."""
    limits = {"rate_limits": cloud.rate_limits}
    app = _application(cloud, "eskin cloud", secure=cloud.secure, limits=limits)
    asked = nodes, gateways, commands, series, comparison, models, prediction, export, events, live
    for resource in (*asked, storage, tokens, audit_log, subjects):
        app.include_router(resource.router, prefix=API)
    app.include_router(health.router)
    app.include_router(login.router)

    @app.get("/openapi.json", include_in_schema=False)
    def get_description(_: Reader) -> Response:
        return as_json(app.openapi())

    app.include_router(dashboard.router)
    return app


def gateway_application(cloud: Cloud) -> FastAPI:
    """Ingest and deliveries; gateways show a certificate when they connect."""
    limits = {
        "rate_limits": RateLimits(cloud.settings.limits),
        "refusal": HTTPStatus.FORBIDDEN,
    }
    # Good ones are not counted: a batch may be a heartbeat.
    app = _application(cloud, "eskin cloud, ingest", secure=True, limits=limits, least_status=300)
    for resource in (ingest, certificates, confirmed, deliveries, notices):
        app.include_router(resource.router, prefix=API)
    return app


def _application(
    cloud: Cloud, title: str, *, secure: bool, limits: dict[str, Any], least_status: int = 0
) -> FastAPI:
    options: dict[str, Any] = {"openapi_url": None, "docs_url": None, "redoc_url": None}
    app = FastAPI(title=title, version=_VERSION, redirect_slashes=False, **options)
    app.state.cloud = cloud
    # The last one added is outermost: refusals carry the headers, too, and are counted.
    app.add_middleware(RecheckMiddleware)
    app.add_middleware(DamagedHeaderMiddleware)
    app.add_middleware(BrokenOffMiddleware)
    app.add_middleware(LimitsMiddleware, **limits)
    app.add_middleware(
        HeadersMiddleware, secure=secure, requests=cloud.metrics.requests, least_status=least_status
    )
    answer_problems(app)
    return app
