"""For who watches over the service: whether it answers, whether it works, and how it goes."""

from __future__ import annotations

from anyio.to_thread import run_sync
from fastapi import APIRouter, Response

from stereo_gpu.service.http.asking import Client, ServiceHere
from stereo_gpu.service.http.models import Health, Readiness
from stereo_gpu.service.http.openapi import body, wrong
from stereo_gpu.service.metrics import MEDIA_TYPE

router = APIRouter(tags=["health"])


# Some proxies and watchers ask with HEAD.
@router.head("/healthz", include_in_schema=False)
@router.get("/healthz", response_model=Health, responses=wrong())
async def healthz() -> Response:
    """That the process answers."""
    return Response(Health(status="ok").model_dump_json(), media_type="application/json")


@router.head("/readyz", include_in_schema=False)
@router.get(
    "/readyz",
    response_model=Readiness,
    responses={**wrong(), 503: {"model": Readiness, "description": "jobs would not be done now; says why"}},
)
async def readyz(service: ServiceHere) -> Response:
    """Whether jobs that came now would be done."""
    reasons = await run_sync(service.not_ready)
    told = Readiness(status="not ready" if reasons else "ready", reasons=reasons)
    return Response(told.model_dump_json(), 503 if reasons else 200, media_type="application/json")


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: body("text/plain", "Prometheus' text format"), **wrong(401)},
)
def metrics(client: Client, service: ServiceHere) -> Response:
    """Counts and times, of all clients together."""
    return Response(service.metrics.page(), media_type=MEDIA_TYPE)
