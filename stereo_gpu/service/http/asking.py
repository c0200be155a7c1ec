"""What routes ask for: the service, who asks, and ids and pages as they stand in addresses."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Path, Query, Request
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer

from stereo_gpu.service.http.models import ID
from stereo_gpu.service.problems import Problem
from stereo_gpu.service.service import Service

MOST_A_PAGE = 200

_bearer = HTTPBearer(
    auto_error=False, scheme_name="token", description="That of the file `token`, or what `--new-token` printed."
)


async def service_of(request: Request) -> Service:  # not worth a thread
    """The service that the app was made for."""
    service: Service = request.app.state.service
    return service


def client_of(
    request: Request,
    service: Annotated[Service, Depends(service_of)],
    given: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)],
) -> str:
    """The name of the client whose token came with the request.

    Raises:
        Problem: there was none, or nobody has it.
    """
    if given is None:
        raise Problem(401, "there is no token: send the header `Authorization: Bearer TOKEN`", _challenge(""))
    client = service.store.client_of(given.credentials)
    if client is None:
        said = "nobody has this token: `stereo-gpu serve --new-token NAME` makes one"
        raise Problem(401, said, _challenge(', error="invalid_token"'))
    request.state.client = client
    return client


def _challenge(error: str) -> dict[str, str]:
    return {"WWW-Authenticate": f'Bearer realm="stereo-gpu"{error}'}


ServiceHere = Annotated[Service, Depends(service_of)]
Client = Annotated[str, Depends(client_of)]
IdHere = Annotated[str, Path(pattern=ID, description="32 hexadecimal digits")]
Limit = Annotated[int, Query(ge=1, le=MOST_A_PAGE, description="at most so many")]
# SQLite counts to here.
After = Annotated[int | None, Query(ge=0, lt=2**63, description="from `next` of the page before")]
