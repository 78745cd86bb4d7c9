"""Health and metrics, for monitoring."""

from typing import Literal

from fastapi import APIRouter, Request
from pydantic import BaseModel
from starlette.responses import Response

from eskin.runtime.http_server.problems import ProblemError, documented
from eskin.runtime.net import is_loopback
from eskin_cloud.api.dependencies import CloudState, address_of

router = APIRouter(tags=["health"])


class HealthDocument(BaseModel):
    """All is well."""

    status: Literal["ok"] = "ok"


@router.get("/healthz")
async def get_health() -> HealthDocument:
    """Check that the process answers."""
    return HealthDocument()


@router.get("/readyz", responses=documented(503))
def get_readiness(cloud: CloudState) -> HealthDocument:
    """Check that the store can be read and written."""
    cloud.store.check()
    return HealthDocument()


@router.get("/metrics", include_in_schema=False)
def get_metrics(cloud: CloudState, request: Request) -> Response:
    """Metrics for Prometheus, on this machine only."""
    if not is_loopback(address_of(request)):
        raise ProblemError(403, "metrics are served on loopback only")
    return Response(cloud.metrics.write(), media_type="text/plain; version=0.0.4")
