"""The OpenAPI document, and what schemathesis makes of it and of the service: requests in order and out of order."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from serving import add_rig, pair_of, post_pair, wait_for

from stereo_gpu.images import write_png
from stereo_gpu.scene import build_scene
from stereo_gpu.scene_render import render_pair

EXAMPLES = 5  # of each request and phase, besides those at the edges of what the document allows
DOCUMENTED = re.compile(r"^\| `(GET|POST|DELETE) (\S+?)`", re.MULTILINE)
# A schema cannot say that a window is odd, that a board has four columns or that depths are in order: these are
# well formed, and wrong.
CONFIGURATION = """
[[operations]]
include-name = [
  "POST /v1/jobs", "POST /v1/rigs", "POST /v1/calibrations", "POST /v1/outlines", "POST /v1/outlines/{id}/mask"
]
checks.positive_data_acceptance.expected-statuses = ["2xx", 401, 404, 409, 422, 429]
"""


@pytest.fixture(scope="module")
def document(served):
    with served.client("") as nobody:
        return nobody.get("/openapi.json").json()


@pytest.fixture(scope="module")
def tiny_folder(tmp_path_factory):
    """A pair and its rig, at a size at which the jobs that are taken cost little."""
    scene = build_scene((160, 120))
    folder = tmp_path_factory.mktemp("tiny")
    for side, picture in zip(("left", "right"), render_pair(scene), strict=True):
        write_png(folder / f"{side}.png", picture)
    scene.rig.save(folder / "rig.json")
    return folder


def operations_of(document):
    return {(method.upper(), path): each for path, some in document["paths"].items() for method, each in some.items()}


def test_the_document_has_what_the_page_of_the_service_has(document):
    text = (Path(__file__).parents[1] / "docs" / "service.md").read_text("utf-8")
    listed = {(method, path.partition("?")[0]) for method, path in DOCUMENTED.findall(text)}
    assert listed - {("GET", "/")} == set(operations_of(document)), listed ^ set(operations_of(document))


def test_every_error_of_the_document_is_a_problem(document):
    for (method, path), operation in operations_of(document).items():
        codes = {int(code) for code in operation["responses"]}
        assert {400, 500, 503} <= codes and (401 in codes) == (path not in ("/healthz", "/readyz"))
        assert (404 in codes) == ("{id}" in path), (method, path)
        assert operation.get("security", []) == ([{"token": []}] if 401 in codes else [])
        for code, answer in operation["responses"].items():
            if int(code) >= 400 and (path, code) != ("/readyz", "503"):
                schema = answer["content"]["application/problem+json"]["schema"]
                assert schema == {"$ref": "#/components/schemas/ProblemView"}, (method, path, code)
    assert document["components"]["securitySchemes"]["token"]["scheme"] == "bearer"
    named = set(re.findall(r"#/components/schemas/(\w+)", json.dumps(document)))
    assert named <= set(document["components"]["schemas"])


def test_schemathesis_finds_nothing(served, tiny_folder, tmp_path):
    from conftest import missing

    try:
        import schemathesis  # noqa: F401
    except ImportError as error:
        missing("service", f"{error}; pip install schemathesis")
    with served.client(served.token_of("schemathesis")) as client:
        token = client.headers["authorization"]
        rig = add_rig(client, tiny_folder)
        job = post_pair(client, tiny_folder, rig, {"profile": "fast", "steps": True}).json()["id"]
        wait_for(client, job)
        outline = client.post("/v1/outlines", files=pair_of(tiny_folder), data={"rig": rig}).json()["id"]
    configuration = tmp_path / "schemathesis.toml"
    configuration.write_text(CONFIGURATION)
    given = {"folder": str(tiny_folder), "rig": rig, "rigs": rig, "jobs": job, "outlines": outline}
    command = [sys.executable, "-m", "schemathesis.cli", "--config-file", str(configuration), "run"]
    command += [f"{served.url}/openapi.json", "-H", f"Authorization: {token}", "--checks", "all", "--seed", "7"]
    command += ["--max-examples", str(EXAMPLES), "--request-timeout", "60", "--no-color", "--continue-on-failure"]
    command += ["--report", "json", "--report-json-path", str(tmp_path / "run.json"), "--generation-database", "none"]
    environment = {
        **os.environ,
        "STEREO_GPU_SCHEMA_GIVEN": json.dumps(given),
        "SCHEMATHESIS_HOOKS": "schema_hooks",
        "PYTHONPATH": str(Path(__file__).parent),
    }
    ran = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=600)
    assert ran.returncode == 0, ran.stdout[-20_000:] + ran.stderr
    report = json.loads((tmp_path / "run.json").read_text())
    assert report["operations"]["tested"] == report["operations"]["total"] >= 23
    assert all(phase["status"] == "success" for phase in report["phases"].values()) and len(report["phases"]) == 4
    assert report["test_cases"]["generated"] > 500 and not report["failures"] and not report["errors"]
    # What is refused at the door tells nothing of what is behind it.
    for name in ("POST /v1/jobs", "POST /v1/rigs", "POST /v1/outlines", "GET /v1/jobs/{id}/files/{name}"):
        assert sum(phase["accepted"] for phase in report["valid_rates"][name].values()) > 0, name
