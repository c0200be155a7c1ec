"""What a connection may hold, where the service listens, and how it stops."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress

import pytest
from conftest import need_service

from stereo_gpu.errors import InputError
from stereo_gpu.service.settings import Settings

need_service_here = pytest.fixture(scope="module", autouse=True)(need_service)
GET = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"


@contextmanager
def listening(header_seconds=0.3, most=8):
    """A small app behind the service's own kind of connections; gives the port."""
    import uvicorn
    from fastapi import FastAPI, Request
    from fastapi.responses import PlainTextResponse, Response

    from stereo_gpu.service import server

    app = FastAPI()

    @app.get("/")
    async def hello():
        return PlainTextResponse("hello")

    @app.get("/large")
    async def large():
        return Response(bytes(64 << 20))

    @app.post("/")
    async def refuse():
        return PlainTextResponse("no", 401)

    @app.post("/read")
    async def read(request: Request):
        return PlainTextResponse(str(len(await request.body())))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(server, "HEADER_SECONDS", header_seconds)
        patch.setattr(server, "MOST_CONNECTIONS", most)
        config = server.configure(app)
    one = uvicorn.Server(config)
    with server.listen(Settings(data=".", port=0)) as listener:
        thread = threading.Thread(target=one.run, args=([listener],))
        thread.start()
        try:
            yield listener.getsockname()[1]
        finally:
            one.should_exit = True
            thread.join()


@pytest.fixture(scope="module")
def port():
    with listening() as port:
        yield port


def connect(port):
    return socket.create_connection(("127.0.0.1", port), timeout=20)


def read(connection):
    """All that comes until the other side closes."""
    answer = bytearray()
    try:
        while piece := connection.recv(1 << 18):
            answer += piece
    except ConnectionError:
        pass
    return bytes(answer)


@pytest.mark.parametrize("said", [b"", b"GET / HT", b"POST /read HTTP/1.1\r\nHost: x\r\nX: "])
def test_who_asks_nothing_is_let_go(said, port):
    with connect(port) as connection:
        connection.sendall(said)
        assert read(connection) == b""


def test_who_drips_a_header_is_let_go(port):
    with connect(port) as connection:
        with pytest.raises(ConnectionError):
            for _ in range(200):  # 10 s, of which 0.3 are allowed
                connection.sendall(b"X")
                time.sleep(0.05)


def test_who_goes_on_with_a_body_that_was_refused_is_let_go(port):
    with connect(port) as connection:
        connection.sendall(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 999999\r\n\r\nabc")
        assert b"401" in connection.recv(1000)
        with pytest.raises(ConnectionError):
            for _ in range(200):
                connection.sendall(b"X")
                time.sleep(0.05)


def test_a_body_may_take_longer_than_a_header(port):
    with connect(port) as connection:
        connection.sendall(b"POST /read HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Length: 4\r\n\r\n")
        for letter in b"abcd":
            time.sleep(0.15)
            connection.sendall(bytes([letter]))
        assert read(connection).endswith(b"\r\n\r\n4")


def test_a_connection_serves_several_requests(port):
    with connect(port) as connection:
        for _ in range(3):
            connection.sendall(GET)
            answer = b""
            while not answer.endswith(b"hello"):
                answer += connection.recv(1000)
            assert answer.startswith(b"HTTP/1.1 200 OK")
            assert b"\r\nserver:" not in answer.lower()
            time.sleep(0.4)  # longer than a header may take: between requests it may rest


@pytest.mark.parametrize(
    "said",
    [
        b"\x16\x03\x01\x02\x00",
        b"hello\r\n\r\n",
        b"GET / HTTP/1.1\r\n\r\n",  # no host
        b"GET / HTTP/1.1\r\nHost: x\r\nX: " + b"y" * 40_000,
        b"GET / HTTP/1.1\r\nHost: x\r\n" + b"a:b\r\n" * 100 + b"\r\n",
        b"POST /read HTTP/1.1\r\nHost: x\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n",
        b"POST /read HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
        GET + b"hello\r\n\r\n",
    ],
)
def test_what_is_no_http_is_told_so(said, port):
    with connect(port) as connection:
        connection.sendall(said)
        head, _, body = read(connection).rpartition(b"\r\n\r\n")
    assert b"HTTP/1.1 400 Bad Request\r\ncontent-type: application/problem+json" in head
    assert json.loads(body)["detail"].startswith("this is no HTTP/1.1 request")


def chunked(size, count):
    return b"POST /read HTTP/1.1\r\nHost: x\r\nConnection: close\r\nTransfer-Encoding: chunked\r\n\r\n" + (
        b"%x\r\n%s\r\n" % (size, b"x" * size) * count + b"0\r\n\r\n"
    )


def test_a_body_may_come_in_chunks_but_not_in_crumbs(port):
    for size, count in ((1, 1000), (300, 20_000), (100_000, 5)):
        with connect(port) as connection:
            connection.sendall(chunked(size, count))
            assert read(connection).endswith(b"\r\n\r\n%d" % (size * count))
    with connect(port) as connection:
        with suppress(ConnectionError):
            connection.sendall(chunked(1, 500_000))
        assert not read(connection).startswith(b"HTTP/1.1 200 ")  # 400, unless the reset was faster


def test_a_body_that_breaks_off_in_the_middle_of_an_answer_is_no_fault(port, caplog):
    with connect(port) as connection:
        connection.sendall(b"POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n")
        assert b"401" in connection.recv(1000)
        connection.sendall(b"zz\r\n")
        read(connection)
    assert caplog.records == []


def test_connections_beyond_the_limit_are_sent_away():
    with listening(header_seconds=5.0, most=8) as port:
        held = [connect(port) for _ in range(8)]
        try:
            for one in held:
                one.sendall(GET)
                assert b"200 OK" in one.recv(1000)
            with connect(port) as one_more:
                answer = read(one_more)
            assert answer.startswith(b"HTTP/1.1 503 Service Unavailable\r\n")
            assert b"retry-after: 5\r\n" in answer
            held.pop().close()
            time.sleep(0.1)
            with connect(port) as again:
                again.sendall(GET)
                assert b"200 OK" in again.recv(1000)
        finally:
            for one in held:
                one.close()


def test_who_takes_nothing_is_cut_off(port, monkeypatch):
    from stereo_gpu.service import connections

    monkeypatch.setattr(connections, "STALL_S", 0.2)
    with connect(port) as connection:
        connection.sendall(GET.replace(b"GET /", b"GET /large"))
        time.sleep(1.0)
        assert len(read(connection)) < 60 << 20
    with connect(port) as connection:  # who takes it is served
        connection.sendall(GET.replace(b"GET /", b"GET /large").replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
        assert len(read(connection)) > 64 << 20


def test_a_port_in_use_is_named():
    from stereo_gpu.service.server import address_of, listen

    with listen(Settings(data=".", port=0)) as listener:
        taken = listener.getsockname()[1]
        assert address_of(listener) == f"http://127.0.0.1:{taken}"
        with pytest.raises(
            InputError, match=rf"^port {taken} of 127\.0\.0\.1 is in use: end what has it, or give another --port$"
        ):
            listen(Settings(data=".", port=taken))


@pytest.mark.parametrize(
    ("host", "port", "line"),
    [
        ("127.0.0.1", 70_000, "port 70000: give 1 to 65535"),
        ("127.0.0.1", -1, "port -1: give 1 to 65535"),
        ("203.0.113.7", 0, "cannot listen at 203.0.113.7 port 0: "),
        ("not a host", 0, "host 'not a host': "),
        ("x" * 300, 0, "host 'xxx"),
    ],
)
def test_where_it_cannot_listen_is_said(host, port, line):
    from stereo_gpu.service.server import listen

    with pytest.raises(InputError) as refused:
        listen(Settings(data=".", host=host, port=port))
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)


def test_it_warns_where_others_can_reach_it(caplog):
    from stereo_gpu.service.server import is_loopback, listen

    with listen(Settings(data=".", host="0.0.0.0", port=0)) as listener:
        assert not is_loopback(listener)
    assert "beyond this machine, and what is sent there is not encrypted" in caplog.text
    caplog.clear()
    with listen(Settings(data=".", port=0)) as listener:
        assert is_loopback(listener)
    assert caplog.text == ""


# -- the whole service, stopped by signals

SERVE = """
import sys
from pathlib import Path
from stereo_gpu.service.server import listen, serve
from stereo_gpu.service.service import Service
from stereo_gpu.service.settings import Settings

if __name__ == "__main__":
    settings = Settings(data=Path(sys.argv[1]), port=0, workers=1, spare_gb=0.0, grace_seconds=60.0)
    listener = listen(settings)
    serve(Service.open(settings), settings, listener, lambda address: print(address, flush=True))
    print("ended", flush=True)
"""


@contextmanager
def process(folder):
    """The service in a process of its own; gives it, and a client."""
    import httpx

    script = folder / "serve.py"
    script.write_text(SERVE)
    command = [sys.executable, str(script), str(folder / "data")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as one:
        try:
            address = one.stdout.readline().strip()
            assert address, one.stderr.read()
            token = (folder / "data" / "token").read_text().strip()
            headers = {"Authorization": f"Bearer {token}"}
            with httpx.Client(base_url=address, headers=headers, timeout=60) as client:
                yield one, client
        finally:
            one.kill()


def send(client, folder, rig, count):
    from serving import pair_of

    options = json.dumps({"profile": "fast", "disparities": [22, 40], "check": "full"})
    jobs = []
    for _ in range(count):
        answer = client.post("/v1/jobs", files=pair_of(folder), data={"rig": rig, "options": options})
        jobs.append(answer.json()["id"])
    return jobs


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_stop_lets_what_has_begun_end_and_keeps_the_rest(tmp_path, raw_folder):
    from serving import add_rig, wait_for

    with process(tmp_path) as (one, client):
        rig = add_rig(client, raw_folder)
        jobs = send(client, raw_folder, rig, 6)
        wait_for(client, jobs[0], states=("running", "done"))
        one.send_signal(signal.SIGTERM)
        told = []
        while one.poll() is None:
            try:
                told.append(client.get("/readyz"))
                refused = client.post("/v1/jobs", files={"left": b"x"})
            except Exception:  # it listens no more
                break
            assert refused.status_code == 503 or told[-1].status_code == 200
        assert one.wait(60) == 0
        assert one.stdout.read() == "ended\n"
        assert "Traceback" not in one.stderr.read()
        assert any(answer.status_code == 503 and "it is stopping" in answer.json()["reasons"] for answer in told)
    with process(tmp_path) as (one, client):
        assert [wait_for(client, job)["state"] for job in jobs] == ["done"] * 6
        assert sum(client.get(f"/v1/jobs/{job}").json()["tries"] for job in jobs) == 6
        one.send_signal(signal.SIGINT)
        assert one.wait(60) == 0


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_second_signal_ends_it_at_once(tmp_path, raw_folder):
    import psutil
    from serving import add_rig, wait_for

    from stereo_gpu.service.store import Store

    with process(tmp_path) as (one, client):
        rig = add_rig(client, raw_folder)
        jobs = send(client, raw_folder, rig, 12)
        wait_for(client, jobs[0], states=("running", "done"))
        workers = psutil.Process(one.pid).children(recursive=True)
        one.send_signal(signal.SIGTERM)
        time.sleep(0.05)
        one.send_signal(signal.SIGTERM)
        assert one.wait(30) == 0
        assert "Traceback" not in one.stderr.read()
        assert psutil.wait_procs(workers, timeout=10)[1] == []
    store = Store(tmp_path / "data" / "service.sqlite3")
    try:
        states = [store.any_job(job).state for job in jobs]
        assert store.check() == []
    finally:
        store.close()
    assert set(states) <= {"done", "queued"}
    assert "queued" in states
