"""The applications: one for people, one for gateways, over the same state."""

from http import HTTPStatus
from typing import Any, Final

from fastapi import FastAPI
from starlette.responses import Response

from eskin.runtime.http_server.rate_limit import LimitsMiddleware, RateLimit
from eskin_cloud.api import (
    alarms,
    audit_log,
    certificates,
    commands,
    comparison,
    confirmed,
    contacts,
    dashboard,
    deliveries,
    descriptions,
    evaluation,
    events,
    export,
    frames,
    gateways,
    gestures,
    health,
    ingest,
    layouts,
    live,
    login,
    models,
    monitors,
    node_monitors,
    nodes,
    notices,
    prediction,
    series,
    storage,
    subjects,
    thresholds,
    tokens,
)
from eskin_cloud.api.dependencies import Reader
from eskin_cloud.api.middleware.answer import AnswerMiddleware
from eskin_cloud.api.middleware.headers import HeadersMiddleware
from eskin_cloud.api.openapi import describe_all
from eskin_cloud.api.problems import PROBLEMS
from eskin_cloud.api.responses import as_json
from eskin_cloud.app_state import AppState

API: Final = "/api/v1"
_VERSION: Final = "1"


def people_application(cloud: AppState) -> FastAPI:
    """REST, live stream and dashboard; all but health and login needs a token or a session."""
    app = _application(cloud, "eskin cloud", secure=cloud.secure, refusal=HTTPStatus.UNAUTHORIZED)
    asked = nodes, gateways, commands, series, frames, contacts, gestures, export, events, live
    of_monitors = evaluation, monitors, node_monitors, alarms
    of_channels = thresholds, comparison, prediction, models
    for resource in (
        *asked,
        *of_monitors,
        *of_channels,
        layouts,
        storage,
        tokens,
        audit_log,
        subjects,
    ):
        app.include_router(resource.router, prefix=API)
    app.include_router(health.router)
    app.include_router(login.router)

    @app.get("/openapi.json", include_in_schema=False)
    def get_description(_: Reader) -> Response:
        return as_json(app.openapi())

    app.include_router(dashboard.router)
    return app


def gateway_application(cloud: AppState) -> FastAPI:
    """Ingest and deliveries; gateways show a certificate when they connect."""
    # Good ones are not counted: a batch may be a heartbeat.
    app = _application(
        cloud,
        "eskin cloud, ingest",
        secure=True,
        refusal=HTTPStatus.FORBIDDEN,
        least_status=300,
    )
    for resource in (ingest, certificates, descriptions, confirmed, deliveries, notices):
        app.include_router(resource.router, prefix=API)
    return app


def _application(
    cloud: AppState, title: str, *, secure: bool, refusal: HTTPStatus, least_status: int = 0
) -> FastAPI:
    options: dict[str, Any] = {"openapi_url": None, "docs_url": None, "redoc_url": None}
    app = FastAPI(title=title, version=_VERSION, redirect_slashes=False, **options)
    app.state.cloud = cloud
    # The last one added is outermost: refusals carry the headers, too, and are counted.
    app.add_middleware(AnswerMiddleware)
    limits = cloud.settings.limits
    app.add_middleware(
        LimitsMiddleware,
        requests=RateLimit.per_second(limits.requests_per_s),
        refused=RateLimit.per_minute(limits.failures_per_min),
        statuses={refusal},
    )
    app.add_middleware(
        HeadersMiddleware, secure=secure, requests=cloud.metrics.requests, least_status=least_status
    )
    PROBLEMS.answer_all(app)
    describe_all(app)
    return app
