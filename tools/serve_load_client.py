"""A client that does not give up: it sends again, with the same key, until the service has answered."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import httpx

from stereo_gpu.errors import StereoError

PATIENCE_S = 300.0
AGAIN = (429, 503, 507)


class Client:
    """One person's program.

    Attributes:
        tries: requests that were sent, those that got no answer with them.
    """

    def __init__(self, url: str, token: str) -> None:
        self._http = httpx.Client(base_url=url, headers={"Authorization": f"Bearer {token}"}, timeout=60)
        self.tries = 0

    def ask(self, method: str, path: str, **more: Any) -> httpx.Response:
        """Send until there is an answer that is one.

        Raises:
            StereoError: it was refused, or there is none for minutes.
        """
        until = time.monotonic() + PATIENCE_S
        while True:
            self.tries += 1
            wait = 0.2
            try:
                answer = self._http.request(method, path, **more)
                if answer.status_code not in AGAIN:
                    break
                wait = float(answer.headers.get("retry-after", 1))
            except httpx.TransportError as error:
                if time.monotonic() > until:
                    raise StereoError(f"{method} {path}: {error}") from error
            if time.monotonic() > until:
                raise StereoError(f"{method} {path}: {answer.status_code} {answer.text}")
            time.sleep(wait)
        if answer.status_code >= 400:
            raise StereoError(f"{method} {path}: {answer.status_code} {answer.text}")
        return answer

    def add_rig(self, path: Path) -> str:
        """The id of a rig."""
        rig: str = self.ask("POST", "/v1/rigs", files={"file": path.read_bytes()}).json()["id"]
        return rig

    def post(self, left: bytes, right: bytes, rig: str, options: dict[str, Any], key: str | None) -> dict[str, Any]:
        """The job of a pair."""
        job: dict[str, Any] = self.ask(
            "POST",
            "/v1/jobs",
            files={"left": ("left.png", left), "right": ("right.png", right)},
            data={"rig": rig, "options": json.dumps(options)},
            headers={"Idempotency-Key": key} if key else {},
        ).json()
        return job

    def job(self, id: str) -> dict[str, Any]:
        """How a job is."""
        job: dict[str, Any] = self.ask("GET", f"/v1/jobs/{id}").json()
        return job

    def model(self, id: str) -> tuple[bytes, str]:
        """model.glb of a job, and the sha256 that the service tells."""
        answer = self.ask("GET", f"/v1/jobs/{id}/files/model.glb")
        return answer.content, answer.headers["etag"].strip('"')

    def jobs(self, **asked: Any) -> list[dict[str, Any]]:
        """All jobs of this client, newest first."""
        found: list[dict[str, Any]] = []
        page = self.ask("GET", "/v1/jobs", params={"limit": 200, **asked}).json()
        while True:
            found += page["items"]
            if page["next"] is None:
                return found
            page = self.ask("GET", page["next"]).json()
