"""The service on a free port of this machine, in a thread of the tests, for those that ask it over HTTP."""

import json
import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import httpx

from stereo_gpu.service.http.app import create_app
from stereo_gpu.service.server import Server, configure, listen
from stereo_gpu.service.service import Service
from stereo_gpu.service.settings import Settings

FAST = {"profile": "fast", "disparities": [22, 40]}  # for the 320 x 240 pair of `raw_folder`
ENDED = ("done", "failed", "cancelled")


class Served:
    """A service that listens; `stop` and `start` are what a restart of it is, on the same port and folder.

    Attributes:
        url: without a slash at its end.
        token: of the first client.
        service: the open one, for what HTTP does not tell.
    """

    def __init__(self, settings):
        self.settings = settings
        self._port = 0
        self.start()
        self.token = self.service.folders.token_file.read_text().strip()

    def start(self):
        # Here, so that tests may import this module where the extra is missing.

        self.service = Service.open(self.settings)
        self.app = create_app(self.service)
        self._server = Server(configure(self.app))
        self._listener = listen(replace(self.settings, port=self._port))
        self._thread = threading.Thread(target=self._server.run, args=([self._listener],))
        self._thread.start()
        while not self._server.started:
            assert self._thread.is_alive()
            time.sleep(0.01)
        self._port = self._listener.getsockname()[1]
        self.url = f"http://127.0.0.1:{self._port}"

    def stop(self, grace_s=1.0):
        self.app.state.streams.stop()
        self._server.should_exit = True
        self._thread.join()
        self.service.close(grace_s)

    def token_of(self, name):
        """A token of another client, who is made if need be."""
        return self.service.store.add_client(name)

    def client(self, token=None):
        """An httpx client with a token; "" for none."""

        token = self.token if token is None else token
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        return httpx.Client(base_url=self.url, headers=headers, timeout=60)


@contextmanager
def serving(data, **settings):
    """A service on this folder until the block ends; one worker, unless told otherwise."""
    served = Served(Settings(**{"data": data, "workers": 1, "spare_gb": 0.0, **settings}))
    try:
        yield served
    finally:
        served.stop()


def add_rig(client, folder):
    """Send rig.json of a folder; gives its id."""
    answer = client.post("/v1/rigs", files={"file": (folder / "rig.json").read_bytes()}, data={"name": "the scene's"})
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


def pair_of(folder):
    """The files of a form with its pair."""
    return {side: (f"{side}.png", (folder / f"{side}.png").read_bytes()) for side in ("left", "right")}


def post_pair(client, folder, rig, options=FAST, *, files=None, headers=None, **fields):
    """Send the pair of a folder; `files` and `fields` besides or instead."""
    data = {"rig": rig, "options": json.dumps(options), **fields}
    return client.post("/v1/jobs", files={**pair_of(folder), **(files or {})}, data=data, headers=headers)


def wait_for(client, job, states=ENDED, seconds=120):
    """A job once it is in one of these states."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        view = client.get(f"/v1/jobs/{job}").json()
        if view["state"] in states:
            return view
        time.sleep(0.02)
    raise AssertionError(f"after {seconds} s it is {view['state']}, at {view['stage']}")
