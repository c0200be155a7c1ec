"""The service over HTTP: docs/service.md says what it answers."""

from __future__ import annotations

from importlib.metadata import version

from fastapi import FastAPI

from stereo_gpu.service.http import routes_files, routes_health, routes_jobs, routes_outlines, routes_page, routes_rigs
from stereo_gpu.service.http.bodies import SmallBodies
from stereo_gpu.service.http.events import Streams
from stereo_gpu.service.http.openapi import install_document
from stereo_gpu.service.http.security import Guard, hosts_of
from stereo_gpu.service.problems import install_problems
from stereo_gpu.service.service import Service

UPLOADS = ("/v1/rigs", "/v1/jobs", "/v1/calibrations", "/v1/outlines")


def create_app(service: Service) -> FastAPI:
    """The app of an open service; who serves it closes the service afterwards.

    `app.state.streams.stop()` ends all event streams, which a server must do before it can end.
    """
    app = FastAPI(
        title="stereo-gpu",
        version=version("stereo-gpu"),
        license_info={"name": "Apache-2.0"},
        docs_url=None,  # its page would fetch scripts from elsewhere
        redoc_url=None,
        redirect_slashes=False,
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.service = service
    app.state.streams = Streams()
    for routes in (routes_rigs, routes_jobs, routes_files, routes_outlines, routes_health, routes_page):
        app.include_router(routes.router)
    install_problems(app)
    install_document(app)
    # The last one added is the outermost.
    app.add_middleware(SmallBodies, seconds=service.settings.idle_seconds, uploads=UPLOADS)
    app.add_middleware(Guard, hosts=hosts_of(service.settings))
    return app
