"""tools/serve_fuzz: some hundred hostile requests, and that what would be wrong with an answer is found out."""

import logging
import sys
from pathlib import Path

import pytest
from conftest import need_service

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))
pytest.importorskip("serve_fuzz_cases", reason="needs the checkout's tools")
from serve_fuzz_cases import Case, Cases

CASES = 300


def answer(status, body=b"{}", kind="application/problem+json"):
    return f"HTTP/1.1 {status} X\r\ncontent-type: {kind}\r\n\r\n".encode() + body


PROBLEM = b'{"type": "about:blank", "title": "X", "status": 422, "detail": "left is missing: give it"}'


@pytest.fixture(scope="module")
def fuzz():
    need_service()
    import serve_fuzz

    return serve_fuzz


@pytest.mark.parametrize(
    ("said", "wrong"),
    [
        (answer(500, PROBLEM), "HTTP/1.1 500"),
        (answer(502, PROBLEM), "HTTP/1.1 502"),
        (answer(422, PROBLEM, "text/plain"), "no problem document"),
        (answer(404, b"nope"), "a problem document that is none"),
        (answer(404, b'{"detail": 5}'), "no line"),
        (answer(404, b'{"detail": "two\\nlines of it"}'), "no line"),
        (answer(200, b'{"path": "/srv/data/jobs"}'), "the answer tells b'/srv/data'"),
        (answer(200) + answer(500, PROBLEM), "HTTP/1.1 500"),
        (answer(404, b'{"detail": "Traceback (most recent call last)"}'), "the answer tells b'Traceback'"),
        (b"", "no answer"),
        (answer(100), "no answer"),
    ],
)
def test_what_is_wrong_with_an_answer_is_found(said, wrong, fuzz):
    assert wrong in fuzz.judge(Case("", ()), said, (b"/srv/data",))[1]


@pytest.mark.parametrize("said", [answer(422, PROBLEM), answer(503, PROBLEM), answer(507, PROBLEM), answer(200), None])
def test_what_is_in_order_is_not(said, fuzz):
    assert fuzz.judge(Case("", ()), said, (b"/srv/data",))[1] == ""


def test_the_service_stands_what_nobody_should_send(fuzz, tmp_path, monkeypatch):
    from serving import serving

    from stereo_gpu.service import server

    monkeypatch.setattr(server, "HEADER_SECONDS", 1.0)
    data = tmp_path / "around" / "data"
    data.parent.mkdir()
    faults = []
    keep = logging.Handler(logging.ERROR)
    keep.emit = lambda record: faults.append(record.getMessage())
    logging.getLogger().addHandler(keep)
    limits = {"file_mb": 2, "request_mb": 5, "megapixels": 4.0, "idle_seconds": 1.0, "upload_seconds": 3.0}
    try:
        with serving(data, **limits) as served, served.client() as client:
            world = fuzz.prepare(client, served.token_of("other"), tmp_path)
            address = ("127.0.0.1", int(served.url.rpartition(":")[2]))
            cases = Cases(world, 5, slow_s=0.01, hang=False)
            outcome = fuzz.attack(address, cases, CASES, (str(tmp_path).encode(), served.token.encode()))
            ends = fuzz.settle(client)
            fuzz.reconstruct_one(client, world.rig, {"left": world.pictures["png"], "right": world.right})
            assert list((data / "uploads").iterdir()) == []
    finally:
        logging.getLogger().removeHandler(keep)
    assert outcome.failures == []
    assert faults == []
    assert list(data.parent.iterdir()) == [data]
    assert ends["done"] > 10 < ends["failed"]  # some did no harm, some were found out by a worker only
    assert {status for _, status in outcome.answers} >= {"200", "202", "400", "404", "415", "422"}
    assert {kind for kind, _ in outcome.answers} == set(cases.kinds)
