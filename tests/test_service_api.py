"""The service over HTTP, as docs/service.md has it: a real server, a real worker, real pictures."""

import hashlib
import json
import threading
import time
from itertools import pairwise

import numpy as np
import pytest
from serving import FAST, add_rig, pair_of, post_pair, wait_for

from stereo_gpu import Rig, read_image, reconstruct
from stereo_gpu.images import write_png
from stereo_gpu.pipeline import STAGES

ABSENT = "0" * 32


@pytest.fixture(scope="module")
def client(served):
    with served.client() as one:
        yield one


@pytest.fixture(scope="module")
def other(served):
    """Another client, who must see nothing of the first one's."""
    with served.client(served.token_of("other")) as one:
        yield one


@pytest.fixture(scope="module")
def rig(client, raw_folder):
    return add_rig(client, raw_folder)


@pytest.fixture(scope="module")
def done(client, raw_folder, rig):
    """A job that has ended well, with pictures of its steps."""
    job = post_pair(client, raw_folder, rig, {**FAST, "steps": True}, label="  a\tcup ").json()
    return wait_for(client, job["id"])


def check_problem(answer, status, *said):
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert set(problem) == {"type", "title", "status", "detail"} and problem["status"] == status
    assert "\n" not in problem["detail"] and all(part in problem["detail"] for part in said), problem["detail"]
    return problem


def test_a_pair_becomes_the_model_that_the_library_makes(client, done, raw_folder, tmp_path):
    assert done["state"] == "done" and done["error"] is None and done["fraction"] == 1.0 and done["tries"] == 1
    assert (
        done["label"] == "a cup" and done["stages"] == [*STAGES, "save"] and set(done["seconds"]) >= {"match", "mesh"}
    )
    result = reconstruct(
        raw_folder / "left.png", raw_folder / "right.png", Rig.load(raw_folder / "rig.json"), **as_arguments(FAST)
    )
    result.save(tmp_path, files="model")
    items = {item["name"]: item for item in client.get(done["links"]["files"]).json()["items"]}
    assert set(items) == {"model.glb", "result.json"}
    model = client.get(items["model.glb"]["href"])
    assert model.content == (tmp_path / "model.glb").read_bytes()
    assert hashlib.sha256(model.content).hexdigest() == items["model.glb"]["sha256"]
    assert model.headers["content-type"] == items["model.glb"]["type"] == "model/gltf-binary"
    assert model.headers["content-disposition"] == 'attachment; filename="model.glb"'
    assert done["summary"]["triangles"] == len(result.mesh.faces)
    assert done["bytes"] >= sum(item["bytes"] for item in items.values())


def as_arguments(options):
    return {name: tuple(value) if isinstance(value, list) else value for name, value in options.items()}


def test_inputs_and_steps_can_be_looked_at(client, done, raw_folder):
    assert [each["name"] for each in done["inputs"]] == ["left.png", "right.png"]
    for each in done["inputs"]:
        sent = client.get(each["href"])
        assert sent.content == (raw_folder / each["given"]).read_bytes() and sent.headers["content-type"] == "image/png"
        assert (each["width"], each["height"]) == (320, 240)
    assert [step["name"] for step in done["steps"]] == ["rectified", "masked", "disparity", "mesh", "textured"]
    for step in done["steps"]:
        answer = client.get(step["href"])
        assert answer.status_code == 200 and answer.headers["content-type"] == "image/jpeg"
        assert answer.content.startswith(b"\xff\xd8\xff")
    check_problem(client.get(f"/v1/jobs/{done['id']}/steps/nothing.jpg"), 404, "nothing.jpg")
    check_problem(client.get(f"/v1/jobs/{done['id']}/inputs/mask.png"), 404, "mask.png")


def test_files_come_whole_in_parts_and_not_at_all_where_they_are_known(client, done):
    href = f"/v1/jobs/{done['id']}/files/model.glb"
    whole = client.get(href)
    etag, content = whole.headers["etag"], whole.content
    assert etag == f'"{hashlib.sha256(content).hexdigest()}"' and whole.headers["accept-ranges"] == "bytes"
    size = len(content)
    for asked, begin, end in (
        ("bytes=0-0", 0, 1),
        ("Bytes=100-299", 100, 300),
        (f"bytes={size - 5}-", size - 5, size),
        ("bytes=-7", size - 7, size),
        (f"bytes=10-{size * 9}", 10, size),
        (f"bytes=-{size * 9}", 0, size),
    ):
        part = client.get(href, headers={"Range": asked})
        assert part.status_code == 206 and part.content == content[begin:end], asked
        assert part.headers["content-range"] == f"bytes {begin}-{end - 1}/{size}"
        assert part.headers["content-length"] == str(end - begin) and part.headers["etag"] == etag
    for asked in ("bytes=5-2", "bytes=a-b", "bytes=", "bytes=-", "lines=0-4", "bytes=0-1,5-6", "bytes 0-1"):
        assert client.get(href, headers={"Range": asked}).status_code == 200, asked
    for asked in (f"bytes={size}-", "bytes=-0", f"bytes={10**17}-"):
        check_problem(client.get(href, headers={"Range": asked}), 416, str(size))
    assert client.get(href, headers={"Range": f"bytes={size}-"}).headers["content-range"] == f"bytes */{size}"
    for known in (etag, f"W/{etag}", f'"other", {etag}', "*"):
        answer = client.get(href, headers={"If-None-Match": known})
        assert answer.status_code == 304 and not answer.content and answer.headers["etag"] == etag
    assert client.get(href, headers={"If-None-Match": '"other"'}).status_code == 200
    resumed = {"Range": "bytes=5-", "If-Range": etag}
    assert client.get(href, headers=resumed).status_code == 206
    assert client.get(href, headers={**resumed, "If-Range": '"other"'}).content == content
    head = client.head(href)
    assert head.status_code == 200 and not head.content and head.headers["content-length"] == str(size)
    head = client.head(href, headers={"Range": "bytes=0-9"})
    assert head.status_code == 200 and head.headers["content-length"] == str(size), "only GET has parts"
    for name in ("nothing.glb", "manifest.json", "..%2finputs%2fleft.png", "%2e%2e", "model.glb%00"):
        check_problem(client.get(f"/v1/jobs/{done['id']}/files/{name}"), 404)


def test_events_tell_every_change_until_the_end(client, raw_folder, rig):
    job = post_pair(client, raw_folder, rig, {"profile": "fast", "steps": True}).json()
    with client.stream("GET", job["links"]["events"]) as stream:
        assert stream.headers["content-type"].startswith("text/event-stream")
        lines = list(stream.iter_lines())
    numbers = [int(line.removeprefix("id: ")) for line in lines if line.startswith("id: ")]
    jobs = [json.loads(line.removeprefix("data: ")) for line in lines if line.startswith("data: ")]
    assert numbers == list(range(len(jobs))) and lines.count("event: job") == len(jobs) >= 2
    assert jobs[-1]["state"] == "done" and all(view["state"] in ("queued", "running") for view in jobs[:-1])
    assert [view["fraction"] for view in jobs] == sorted(view["fraction"] for view in jobs)
    assert jobs[-1] == client.get(job["links"]["self"]).json()
    assert all(before != after for before, after in pairwise(jobs))
    # Of one that has ended there is one event; a reader that comes back goes on counting.
    again = client.get(job["links"]["events"], headers={"Last-Event-ID": "7"}).text
    assert again.startswith("event: job\nid: 8\ndata: ") and again.count("event: ") == 1


def test_a_retry_with_a_key_is_the_same_job(client, raw_folder, rig):
    headers = {"Idempotency-Key": "a-key-of-mine"}
    first, again = (post_pair(client, raw_folder, rig, headers=headers) for _ in range(2))
    assert (first.status_code, again.status_code) == (202, 200)
    assert first.json()["id"] == again.json()["id"] and first.headers["location"] == again.headers["location"]
    check_problem(post_pair(client, raw_folder, rig, label="else", headers=headers), 422, "a-key-of-mine")
    for key in ("", "with space", "a" * 201, "\xe9"):
        check_problem(post_pair(client, raw_folder, rig, headers={"Idempotency-Key": key.encode("latin-1")}), 422)
    wait_for(client, first.json()["id"])
    assert post_pair(client, raw_folder, rig, headers=headers).json()["state"] == "done"


def test_what_one_client_sent_another_cannot_see(client, other, served, done, rig, raw_folder):
    for path in (
        f"/v1/jobs/{done['id']}",
        done["links"]["files"],
        done["links"]["events"],
        f"/v1/jobs/{done['id']}/files/model.glb",
        done["inputs"][0]["href"],
        done["steps"][0]["href"],
        f"/v1/rigs/{rig}",
        f"/v1/rigs/{rig}/file",
    ):
        assert client.get(path).status_code == 200
        theirs = check_problem(other.get(path), 404)
        absent = check_problem(client.get(path.replace(done["id"], ABSENT).replace(rig, ABSENT)), 404)
        # Not even whether there is such a thing.
        assert theirs["detail"].replace(done["id"], ABSENT).replace(rig, ABSENT) == absent["detail"]
        with served.client("") as nobody:
            answer = nobody.get(path)
        check_problem(answer, 401, "Authorization: Bearer")
        assert answer.headers["www-authenticate"].startswith("Bearer")
    for method, path in (("POST", "cancel"), ("POST", "restart"), ("DELETE", "")):
        check_problem(other.request(method, f"/v1/jobs/{done['id']}/{path}".rstrip("/")), 404)
    check_problem(other.delete(f"/v1/rigs/{rig}"), 404)
    check_problem(post_pair(other, raw_folder, rig), 422, rig)
    assert other.get("/v1/jobs").json() == {"items": [], "next": None} == other.get("/v1/rigs").json()


@pytest.mark.parametrize(
    "given", ["Bearer wrong", "Bearer", "Basic b3duZXI6", "Bearer \xe9\xff", "wrong", "Bearer a b"]
)
def test_a_wrong_token_is_refused(served, given):
    with served.client("") as nobody:
        for path in ("/v1/jobs", "/metrics"):
            check_problem(nobody.get(path, headers={"Authorization": given.encode("latin-1")}), 401, "token")


def test_what_is_wrong_with_a_pair_is_one_line(client, raw_folder, rig, tmp_path):
    half = np.ascontiguousarray(read_image(raw_folder / "right.png")[:, :160])
    small = (write_png(tmp_path / "half.png", half)).read_bytes()
    black = ("mask.png", small)
    for wrong, said in (
        ({"files": {"right": ("r.png", small)}}, ("left is 320 x 240 px, right is 160 x 240 px",)),
        ({"files": {"left": ("l.png", small), "right": ("r.png", small)}}, ("160 x 240", "320 x 240")),
        ({"files": {"mask": black}}, ("mask is 160 x 240 px", "320 x 240")),
        ({"files": {"left": ("l.png", b"no picture at all")}}, ("left (l.png)", "no picture")),
        ({"rig": ABSENT}, ("there is no rig", ABSENT)),
        ({"rig": "../../etc/passwd"}, ("there is no rig",)),
        ({"options": {"profile": "best"}}, ("best",)),
        ({"options": {"disparities": [0, 0]}}, ("0",)),
        ({"options": {"colour": True}}, ("colour", "unknown")),
        ({"options": {"mesh": {"smoothing": -1}}}, ("smoothing",)),
        ({"options": []}, ("options",)),
    ):
        check_problem(post_pair(client, raw_folder, **{"rig": rig, **wrong}), 422, *said)
    files = pair_of(raw_folder)
    check_problem(client.post("/v1/jobs", files=files), 422, "rig is missing")
    check_problem(client.post("/v1/jobs", files={"left": files["left"]}, data={"rig": rig}), 422, "right is missing")
    check_problem(client.post("/v1/jobs", json={"rig": rig}), 415, "multipart/form-data")
    check_problem(client.post("/v1/jobs"), 415, "multipart/form-data")


def test_what_the_request_is_not(client, served):
    check_problem(client.get("/v1/nothing"), 404, "/v1/nothing")
    check_problem(client.get("/v1/jobs/"), 404)
    check_problem(client.get("/v1/jobs/0123"), 404, "32")
    check_problem(client.get("/v1/jobs?limit=0"), 422, "limit = '0'")
    check_problem(client.get("/v1/jobs?limit=x"), 422, "limit = 'x'")
    check_problem(client.get(f"/v1/jobs?after={10**30}"), 422, "after")
    check_problem(client.get("/v1/jobs?state=lost"), 422, "queued")
    for method, path, allowed in (
        ("PUT", "/v1/jobs", "GET, POST"),
        ("PATCH", f"/v1/jobs/{ABSENT}", "DELETE, GET"),
        ("GET", f"/v1/jobs/{ABSENT}/cancel", "POST"),
        ("DELETE", "/healthz", "GET, HEAD"),
        ("BREW", "/v1/rigs", "GET, POST"),
    ):
        answer = client.request(method, path)
        check_problem(answer, 405, method)
        assert answer.headers["allow"] == allowed


def test_rigs_come_as_they_went_and_go(client, raw_folder, done, rig, tmp_path):
    view = client.get(f"/v1/rigs/{rig}").json()
    true = Rig.load(raw_folder / "rig.json")
    assert view["summary"]["baseline"] == pytest.approx(true.baseline) and view["summary"]["width"] == 320
    assert view["checked"], "a pair has been found right with it"
    (tmp_path / "back.json").write_bytes(client.get(view["links"]["file"]).content)
    back = Rig.load(tmp_path / "back.json")
    assert np.array_equal(back.left.matrix, true.left.matrix) and np.array_equal(back.T, true.T)
    gone = add_rig(client, raw_folder)
    assert client.delete(f"/v1/rigs/{gone}").status_code == 204
    check_problem(client.get(f"/v1/rigs/{gone}"), 404, gone)
    check_problem(client.delete(f"/v1/rigs/{gone}"), 404, gone)


def test_rigs_of_other_programs_are_taken(client):
    camera = "camera_matrix: {rows: 3, cols: 3, data: [500, 0, 320, 0, 500, 240, 0, 0, 1]}\n"
    camera += "image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\ncamera_name: one\n"
    camera += "distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n"
    camera += "rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
    left = camera + "projection_matrix: {rows: 3, cols: 4, data: [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0]}\n"
    right = left.replace("320, 0, 0, 500", "320, -50, 0, 500")
    answer = client.post(
        "/v1/rigs", files=[("file", ("right.yaml", right)), ("file", ("left.yaml", left))], data={"unit": "cm"}
    )
    assert answer.status_code == 201, answer.text
    summary = answer.json()["summary"]
    assert (summary["width"], summary["height"], summary["unit"]) == (640, 480, "cm")
    assert summary["baseline"] == pytest.approx(10.0) and summary["rms_px"] is None
    for content, said in (
        (b"", "empty"),
        (b"{", "mine.json"),
        (b"\x00\x01\x02" * 50, "mine.json"),
        (b"a: b", "mine.json"),
    ):
        problem = check_problem(client.post("/v1/rigs", files={"file": ("mine.json", content)}), 422, said)
        assert "uploads" not in problem["detail"] and "file0" not in problem["detail"]
    check_problem(client.post("/v1/rigs", files={"file": ("mine.json", b"1" * (3 << 20))}), 413, "mine.json")
    check_problem(client.post("/v1/rigs", files={"file": left.encode()}, data={"size": "big"}), 422, "640x480")


def test_board_pictures_become_a_rig(client, data, tmp_path):
    folder = data / "calibration" / "board_10x7"
    files = [
        (side, (path.name, path.read_bytes()))
        for side in ("left", "right")
        for path in sorted(folder.glob(f"{side}*"))[:4]
    ]
    form = {"board": "10x7", "square": "30", "label": "the real board"}
    answer = client.post("/v1/calibrations", files=files, data=form, headers={"Idempotency-Key": "boards"})
    assert answer.status_code == 202, answer.text
    assert answer.json()["kind"] == "calibration" and answer.json()["options"] == {"board": "10x7", "square": 30.0}
    assert [each["name"] for each in answer.json()["inputs"]][:2] == ["left000.jpg", "left001.jpg"]
    again = client.post("/v1/calibrations", files=files, data=form, headers={"Idempotency-Key": "boards"})
    assert again.status_code == 200 and again.json()["id"] == answer.json()["id"]
    ended = wait_for(client, answer.json()["id"])
    assert ended["state"] == "done", ended["error"]
    rig = client.get(f"/v1/rigs/{ended['rig']}").json()
    assert rig["calibration"] == ended["id"] and rig["name"] == "the real board"
    assert 0 < rig["summary"]["rms_px"] < 0.5 and rig["summary"]["baseline"] == pytest.approx(100, abs=1)
    names = {item["name"] for item in client.get(ended["links"]["files"]).json()["items"]}
    assert {"rig.json", "report.html", "calibration.json", "coverage-left.svg"} <= names
    (tmp_path / "rig.json").write_bytes(client.get(rig["links"]["file"]).content)
    assert Rig.load(tmp_path / "rig.json").baseline == pytest.approx(rig["summary"]["baseline"])


def test_what_is_wrong_with_boards_is_one_line(client, raw_folder):
    left, right = ((side, file) for side, file in pair_of(raw_folder).items())
    good = {"board": "10x7", "square": "30"}
    for files, fields, *said in (
        ([left, left, right], good, "left has 2 pictures, right has 1"),
        ([left, right], {"board": "10x7"}, "square is missing"),
        ([left, right], {**good, "board": "large"}, "large", "10x7"),
        ([left, right], {**good, "board": "2x2"}, "2"),
        ([left, right], {**good, "square": "wide"}, "square = 'wide'", "mm"),
        ([left, right], {**good, "square": "nan"}, "square"),
        ([left, right], {**good, "square": "-3"}, "square"),
        ([left, right], {**good, "dictionary": "5x5_250"}, "marker"),
        ([left, right], {**good, "marker": "40"}, "40"),
        ([left, right], {**good, "pairs": "1"}, "'pairs' is no field"),
        ([left], good, "right is missing"),
    ):
        check_problem(client.post("/v1/calibrations", files=files, data=fields), 422, *said)


def test_pages_of_jobs_are_whole_and_in_order(client, raw_folder, rig):
    made = [post_pair(client, raw_folder, rig, label=f"page {n}").json()["id"] for n in range(5)]
    seen, path = [], "/v1/jobs?limit=2"
    while path:
        page = client.get(path).json()
        assert len(page["items"]) == 2 or page["next"] is None
        seen += [job["id"] for job in page["items"]]
        path = page["next"]
    assert seen[:5] == made[::-1] and len(seen) == len(set(seen))
    for job in made:
        wait_for(client, job)
    assert all(job["state"] == "done" for job in client.get("/v1/jobs?state=done&limit=200").json()["items"])
    kinds = {job["kind"] for job in client.get("/v1/jobs?kind=reconstruction&limit=200").json()["items"]}
    assert kinds == {"reconstruction"}


def test_cancel_restart_and_delete(client, raw_folder, rig, served):
    # The only worker has the first, or one of the next; the last waits.
    *_, first, second = (post_pair(client, raw_folder, rig, {"profile": "precise"}).json() for _ in range(6))
    check_problem(client.get(second["links"]["files"]), 409, "once it is done")
    check_problem(client.delete(second["links"]["self"]), 409, "cancel it first")
    check_problem(client.post(f"{second['links']['self']}/restart"), 409)
    assert client.post(f"{second['links']['self']}/cancel").json()["state"] in ("cancelled", "running")
    assert wait_for(client, second["id"])["state"] == "cancelled"
    assert client.post(f"{second['links']['self']}/cancel").status_code == 200, "a retry of the same wish"
    again = client.post(f"{second['links']['self']}/restart")
    assert again.status_code == 202 and again.json()["state"] in ("queued", "running")
    assert wait_for(client, second["id"])["state"] == "done" and wait_for(client, first["id"])["state"] == "done"
    check_problem(client.post(f"{second['links']['self']}/cancel"), 409, "done")
    check_problem(client.post(f"{second['links']['self']}/restart"), 409, "done")
    assert client.delete(second["links"]["self"]).status_code == 204
    check_problem(client.get(second["links"]["self"]), 404, second["id"])
    check_problem(client.delete(second["links"]["self"]), 404)
    assert not served.service.folders.job(second["id"]).exists()


def test_a_rig_stays_while_a_job_needs_it(client, raw_folder):
    rig = add_rig(client, raw_folder)
    job = [post_pair(client, raw_folder, rig, {"profile": "precise"}).json() for _ in range(3)][-1]
    check_problem(client.delete(f"/v1/rigs/{rig}"), 409, rig)
    wait_for(client, job["id"])
    assert client.delete(f"/v1/rigs/{rig}").status_code == 204
    assert client.get(job["links"]["self"]).json()["rig"] == rig


def test_a_pair_that_cannot_be_done_fails_with_its_reason(client, raw_folder, rig, tmp_path):
    grey = write_png(tmp_path / "grey.png", np.full((240, 320, 3), 90, np.uint8)).read_bytes()
    job = post_pair(client, raw_folder, rig, files={"left": ("l.png", grey), "right": ("r.png", grey)}).json()
    failed = wait_for(client, job["id"])
    assert failed["state"] == "failed" and failed["error"] and "\n" not in failed["error"]
    assert "/" not in failed["error"], "where the service keeps its files is none of the client's business"
    cut = (raw_folder / "left.png").read_bytes()[:5000]
    job = post_pair(client, raw_folder, rig, files={"left": ("cut.png", cut)}).json()
    assert "cut off" in wait_for(client, job["id"])["error"]


def test_a_full_queue_says_when_to_come_back(served, client, raw_folder, rig, monkeypatch):
    monkeypatch.setattr(served.service, "settings", served.settings.__class__(data=served.settings.data, queue_limit=0))
    answer = post_pair(client, raw_folder, rig)
    check_problem(answer, 429, "the limit is 0")
    assert 1 <= int(answer.headers["retry-after"]) <= 60
    assert not list(served.service.folders.uploads.iterdir()), "what was sent is removed"


def test_a_body_that_is_no_json_or_too_large(client, served):
    mask = f"/v1/outlines/{ABSENT}/mask"
    check_problem(client.post(mask, content=b"{", headers={"Content-Type": "application/json"}), 400, "JSON")
    check_problem(client.post(mask, content=b"{}", headers={"Content-Type": "text/plain"}), 415, "text/plain")
    check_problem(client.post(mask, json={"wanted": 3}), 422, "wanted = 3")
    check_problem(client.post(mask, json={"wanted": [], "colour": 1}), 422, "colour")
    check_problem(client.post(mask, json={"two\nlines": 1}), 422, "two lines = 1")
    many = b'{"rectangle": [' + b"9" * 5000 + b", 1, 1, 1]}"
    check_problem(client.post(mask, content=many, headers={"Content-Type": "application/json"}), 400, "digits")
    check_problem(client.post(mask, json={}), 404)
    nested = b'{"wanted": ' + b"[" * 100_000
    assert client.post(mask, content=nested, headers={"Content-Type": "application/json"}).status_code in (400, 422)
    # Whatever it says it is, and with or without a token: the framework would read it first.
    for kind in ("application/json", "multipart/form-data; boundary=x", "text/plain"):
        with served.client("") as nobody:
            for path in (mask, f"/v1/jobs/{ABSENT}/cancel", "/v1/nothing"):
                answer = nobody.post(path, content=b"x" * (1 << 21), headers={"Content-Type": kind})
                check_problem(answer, 413, "1048576")

    def endless():
        for _ in range(64):
            yield b"[" * (1 << 16)

    check_problem(client.post(mask, content=endless(), headers={"Content-Type": "application/json"}), 413, "1048576")


def test_a_body_that_comes_slowly_is_given_up(served):
    import asyncio

    from stereo_gpu.service.http.bodies import SmallBodies

    said = []

    async def crumbs():
        await asyncio.sleep(0.02)
        return {"type": "http.request", "body": b" ", "more_body": True}

    async def send(message):
        said.append(message)

    async def ask():
        slow = SmallBodies(served.app, seconds=0.2, uploads=())
        headers = [(b"host", b"localhost"), (b"content-type", b"application/json")]
        scope = {"type": "http", "method": "POST", "path": f"/v1/outlines/{ABSENT}/mask", "headers": headers}
        await slow({**scope, "query_string": b"", "http_version": "1.1", "scheme": "http"}, crumbs, send)

    asyncio.run(ask())
    assert said[0]["status"] == 408 and b"over 0.2 s" in said[1]["body"]


def test_an_open_stream_outlives_a_body_that_never_comes(served):
    import asyncio

    from stereo_gpu.service.http.bodies import LARGEST, SmallBodies

    heard = []
    sent = asyncio.Queue()

    async def streaming(scope, receive, send):
        first = asyncio.create_task(receive())
        await asyncio.sleep(0)
        await send({"type": "http.response.start", "status": 200, "headers": []})
        heard.append(await first)
        heard.append(await receive())

    async def nothing(message):
        pass

    async def ask():
        body = {"type": "http.request", "body": b" " * (LARGEST + 1), "more_body": True}
        asyncio.get_running_loop().call_later(0.3, sent.put_nowait, body)
        asyncio.get_running_loop().call_later(0.3, sent.put_nowait, {"type": "http.disconnect"})
        scope = {"type": "http", "method": "GET", "path": f"/v1/jobs/{ABSENT}/events", "headers": []}
        await SmallBodies(streaming, seconds=0.1, uploads=())(scope, sent.get, nothing)

    asyncio.run(ask())
    assert [message["type"] for message in heard] == ["http.request", "http.disconnect"]


def test_every_answer_has_the_headers_that_keep_a_browser_safe(client, served, done):
    for path in ("/v1/jobs", "/v1/nothing", "/healthz", "/", "/page/main.js", f"/v1/jobs/{done['id']}/files/model.glb"):
        headers = client.get(path).headers
        assert headers["x-content-type-options"] == "nosniff" and headers["referrer-policy"] == "no-referrer"
        assert headers["x-frame-options"] == "DENY" and "frame-ancestors 'none'" in headers["content-security-policy"]
        assert "server" not in headers and "set-cookie" not in headers and "access-control-allow-origin" not in headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy and "unsafe" not in policy
        assert ("script-src 'self'" in policy) == (path in ("/", "/page/main.js"))
    assert client.get("/v1/jobs").headers["cache-control"] == "no-store"


def test_only_the_name_of_this_machine_is_answered(served):
    with served.client() as client:
        for host in ("evil.example", "evil.example:8000", "localhost.evil.example", ""):
            check_problem(client.get("/v1/jobs", headers={"Host": host}), 400, "host")
        for host in ("localhost", "127.0.0.1:1", "[::1]:8000", "LOCALHOST:80"):
            assert client.get("/v1/jobs", headers={"Host": host}).status_code == 200


def test_health_readiness_and_metrics(client, served, done):
    with served.client("") as nobody:
        assert nobody.get("/healthz").json() == {"status": "ok"}
        assert nobody.get("/readyz").json() == {"status": "ready", "reasons": []}
        assert nobody.head("/healthz").status_code == 200 == nobody.head("/readyz").status_code
    page = client.get("/metrics")
    assert page.headers["content-type"].startswith("text/plain")
    values = dict(line.rsplit(" ", 1) for line in page.text.splitlines() if not line.startswith("#"))
    assert float(values['stereo_gpu_jobs{state="done"}']) >= 1
    assert float(values['stereo_gpu_jobs_accepted_total{kind="reconstruction"}']) >= 1
    assert float(values["stereo_gpu_upload_bytes_total"]) > 100_000


def test_the_page_and_its_parts(served):
    with served.client("") as nobody:
        index = nobody.get("/")
        assert index.headers["content-type"] == "text/html; charset=utf-8" and "<script" in index.text
        three = nobody.get("/page/three.js")
        assert three.headers["content-type"] == "text/javascript; charset=utf-8" and "THREE.GLTFLoader" in three.text
        assert nobody.get("/page/three.js", headers={"If-None-Match": three.headers["etag"]}).status_code == 304
        for name in ("nothing.js", "..%2fapp.py", "app.py", "%2e%2e"):
            check_problem(nobody.get(f"/page/{name}"), 404)


def test_a_fault_says_nothing_of_itself(client, served, monkeypatch, caplog):
    def fail(*_, **__):
        raise ZeroDivisionError("secret")

    monkeypatch.setattr(served.service.store, "job", fail)
    answer = client.get(f"/v1/jobs/{ABSENT}")
    problem = check_problem(answer, 500, answer.headers["x-request-id"])
    assert "secret" not in json.dumps(problem) and "secret" in caplog.text


def test_many_clients_at_once_get_what_is_theirs(served, raw_folder):
    ended = {}

    def work(name):
        with served.client(served.token_of(name)) as own:
            rig = add_rig(own, raw_folder)
            jobs = [post_pair(own, raw_folder, rig, label=f"{name} {n}").json()["id"] for n in range(3)]
            views = [wait_for(own, job) for job in jobs]
            listed = [job["label"] for job in own.get("/v1/jobs").json()["items"]]
            ended[name] = ([view["state"] for view in views], listed)

    threads = [threading.Thread(target=work, args=(f"client{n}",)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for n in range(4):
        states, listed = ended[f"client{n}"]
        assert states == ["done"] * 3 and listed == [f"client{n} {k}" for k in (2, 1, 0)]


def test_streams_end_when_the_service_stops_and_jobs_go_on_after(tmp_path, raw_folder, served):
    from serving import serving

    with serving(tmp_path / "data", backend=None) as own, own.client() as client:
        rig = add_rig(client, raw_folder)
        job = post_pair(client, raw_folder, rig, {"profile": "precise"}).json()
        began = time.monotonic()
        with client.stream("GET", job["links"]["events"]) as stream:
            lines = stream.iter_lines()
            assert next(lines) == "event: job"
            own.stop(grace_s=0.0)
            rest = list(lines)
        assert rest and time.monotonic() - began < 30
        own.start()
        assert wait_for(client, job["id"])["state"] == "done"
