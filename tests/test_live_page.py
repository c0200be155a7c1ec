"""The page, asked for over HTTP."""

import http.client
import json
import re
import socket
import threading
import time

import cv2
import numpy as np
import pytest
from moving_boards import BOARD, frame, pose, render

from stereo_gpu.errors import InputError
from stereo_gpu.recording import live_page, page_server
from stereo_gpu.recording.board_watch import BoardChooser
from stereo_gpu.recording.live_page import LivePage
from stereo_gpu.recording.page_server import parse_address


@pytest.fixture(scope="module")
def pictures():
    return render(pose(0))


@pytest.fixture
def page():
    with LivePage(BOARD, port=0) as page:
        yield page


@pytest.fixture
def chooser(page):
    return BoardChooser(BOARD, still=False, shows=[page.show])


def get(page, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=5)
    try:
        connection.putrequest(method, path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


def state(page):
    status, headers, body = get(page, "/state.json")
    assert status == 200 and headers["Content-Type"] == "application/json"
    return json.loads(body)


def picture(page, path):
    status, headers, body = get(page, path)
    assert status == 200 and headers["Content-Type"] == "image/jpeg"
    return cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR_RGB)


def test_the_page_is_complete(page):
    status, headers, body = get(page, "/")
    text = body.decode()
    assert status == 200 and headers["Content-Type"] == "text/html; charset=utf-8"
    assert "$css" not in text and "--accent" in text
    assert re.findall(r"https?://", text) == []  # nothing from elsewhere
    assert "default-src 'none'" in text
    assert headers["Cache-Control"] == "no-store" and headers["X-Frame-Options"] == "DENY"


def test_before_the_first_picture(page):
    assert state(page) == {"number": 0, "status": "waiting for the first pictures"}
    assert get(page, "/left.jpg")[0] == 404
    assert get(page, "/pair/1/left.jpg")[0] == 404


def test_pictures_and_state_of_a_capture(page, chooser, pictures):
    assert chooser.choose(frame(1, pictures))
    assert not chooser.choose(frame(2, pictures))
    told = state(page)
    assert (told["number"], told["pairs"], told["taken"], told["done"]) == (2, 1, False, False)
    assert (told["size"], told["board"], told["columns"], told["recent"]) == ([640, 480], "10x7", 9, [1])
    assert told["status"] == chooser.status
    assert told["progress"] == pytest.approx(chooser.coverage.progress, abs=1e-3)
    for side, camera in enumerate(told["cameras"]):
        coverage = chooser.coverage.cameras[side]
        assert camera["cells"] == coverage.cells.tolist() and sum(map(sum, camera["cells"])) > 4
        assert camera["missing"] == chooser.coverage.missing()[side]
        assert len(camera["wanted"]) == len(chooser.coverage.wanted_regions()[side])
        assert camera["ids"] == list(range(54))
        known = BOARD.find(pictures[side]).corners
        corners = np.array(camera["corners"]) * (640, 480) - 0.5
        assert min(np.abs(corners - known).max(), np.abs(corners - known[::-1]).max()) < 1.5
        name = ("left", "right")[side]
        shown = picture(page, f"/{name}.jpg?n=2")
        assert shown.shape == (480, 640, 3)
        assert np.abs(shown.astype(int) - pictures[side]).mean() < 5
        small = picture(page, f"/pair/1/{name}.jpg")
        assert small.shape == (150, 200, 3)
        assert np.abs(small.astype(int) - cv2.resize(pictures[side], (200, 150), interpolation=3)).mean() < 6
    assert told["cameras"][0]["wanted"][0] == [0.25, 0, 0.75, pytest.approx(1 / 6)]  # the top


def test_a_picture_belongs_to_the_state_that_named_it(page, chooser, pictures, monkeypatch):
    monkeypatch.setattr(live_page, "CLIENT_S", 600)  # however slow this computer is just now
    state(page)  # from now on somebody looks
    dark = tuple(picture // 4 for picture in pictures)
    for number in range(1, 5):
        chooser.choose(frame(number, dark if number == 2 else pictures))
    assert picture(page, "/left.jpg?n=2").mean() < 50
    for path in ("/left.jpg?n=3", "/left.jpg", "/left.jpg?n=99", "/left.jpg?n=-1", "/left.jpg?n=x", "/left.jpg?m=2"):
        assert picture(page, path).mean() > 80


def test_large_pictures_grey_ones_and_16_bits_are_shown_small(page):
    chooser = BoardChooser(BOARD, still=False, shows=[page.show])
    for number, (picture_, shape) in enumerate(
        (
            (np.full((1200, 1600), 90, np.uint8), (600, 800, 3)),
            (np.full((1200, 1600), 900, np.uint16), (600, 800, 3)),
            (np.full((1200, 1600, 3), 90, np.uint8), (600, 800, 3)),
        ),
        start=1,
    ):
        chooser.choose(frame(number, (picture_, picture_)))
        assert state(page)["number"] == number
        assert picture(page, f"/right.jpg?n={number}").shape == shape


def test_all_else_is_not_found(page, chooser, pictures):
    chooser.choose(frame(1, pictures))
    assert get(page, "/pair/1/left.jpg")[0] == 200
    for path in (
        "/nothing",
        "/../pyproject.toml",
        "/pair/../../etc/passwd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/pair/1/left.png",
        "/pair/2/left.jpg",
        "/pair/x/left.jpg",
        "/pair//left.jpg",
        "/pair/1/1/left.jpg",
        "/pair/999999999999999999999/left.jpg",
        "/left.jpg/",
        "//left.jpg",
        "/LEFT.JPG",
    ):
        assert get(page, path)[0] == 404, path


def test_nothing_but_get(page):
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert get(page, "/", method)[0] == 501


def test_a_foreign_name_is_refused(page):
    """A page on the web may point a name of its own at this computer, and then read what it serves."""
    for host in ("evil.example", "evil.example:8765", "127.0.0.1.evil.example", "", "localhost.evil.example:80"):
        for path in ("/", "/state.json", "/left.jpg"):
            assert get(page, path, Host=host)[0] == 403
    for host in ("localhost:9000", "127.0.0.1", f"LOCALHOST:{page.port}", "[::1]:80"):
        assert get(page, "/state.json", Host=host)[0] == 200


def test_only_this_computer_can_reach_it(page):
    assert page._server.socket.getsockname()[0] == "127.0.0.1"
    assert page.url == f"http://127.0.0.1:{page.port}/"


def test_the_way_through_ssh_is_told(page, monkeypatch):
    monkeypatch.delenv("SSH_CONNECTION", raising=False)
    assert page.directions == [f"open {page.url} to see both pictures"]
    monkeypatch.setenv("SSH_CONNECTION", "10.0.0.1 50000 10.0.0.2 22")
    assert f"ssh -L {page.port}:localhost:{page.port} " in page.directions[1]


def test_an_address_that_others_reach_is_said(pictures):
    with LivePage(BOARD, host="0.0.0.0", port=0) as page:
        assert page.url == f"http://127.0.0.1:{page.port}/"
        assert page.directions[1] == f"whoever reaches this computer at port {page.port} can see them too"
        assert get(page, "/state.json", Host="lab-pc.example")[0] == 200


def test_ports():
    with LivePage(BOARD, port=0) as first:
        with pytest.raises(InputError, match=f"no page at 127.0.0.1:{first.port}: .* give another port with --page"):
            LivePage(BOARD, port=first.port)
        with LivePage(BOARD) as usual, LivePage(BOARD) as free:  # where 8765 is taken, any other
            assert len({first.port, usual.port, free.port}) == 3
    with LivePage(BOARD, port=first.port) as again:  # given back
        assert again.port == first.port
    with pytest.raises(InputError, match=r"no page at 192\.0\.2\.1:0"):
        LivePage(BOARD, host="192.0.2.1", port=0)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("8765", ("127.0.0.1", 8765)),
        ("0", ("127.0.0.1", 0)),
        (" 0.0.0.0:80 ", ("0.0.0.0", 80)),
        ("[::1]:9000", ("::1", 9000)),
        (":9000", ("127.0.0.1", 9000)),
    ],
)
def test_addresses(text, address):
    assert parse_address(text) == address


@pytest.mark.parametrize("text", ["", "x", "-1", "65536", "1.5", "host:", "8765:x", "٣", "9" * 40])
def test_no_address(text):
    with pytest.raises(InputError, match="give a port such as 8765"):
        parse_address(text)


def test_many_dead_and_slow_clients_do_no_harm(page, chooser, pictures, monkeypatch):
    monkeypatch.setattr(page_server._Handler, "timeout", 0.5)
    silent = [socket.create_connection(("127.0.0.1", page.port), timeout=5) for _ in range(60)]
    try:
        for client in silent[::2]:
            client.sendall(b"GET /state.json HTTP/1.1\r\nHost: localhost\r\n")  # and no more
        chooser.choose(frame(1, pictures))
        handlers = [thread for thread in threading.enumerate() if "process_request_thread" in thread.name]
        assert len(handlers) <= page_server.MOST_CONNECTIONS
        deadline = time.monotonic() + 20
        while True:  # as soon as the silent ones are hung up on
            try:
                assert state(page)["number"] == 1
                break
            except (OSError, http.client.HTTPException):
                assert time.monotonic() < deadline
                time.sleep(0.05)
    finally:
        for client in silent:
            client.close()


def test_a_client_that_hangs_up_in_a_picture(page, chooser, pictures, capfd):
    chooser.choose(frame(1, pictures))
    state(page)
    for _ in range(5):
        with socket.create_connection(("127.0.0.1", page.port), timeout=5) as client:
            client.sendall(b"GET /left.jpg HTTP/1.1\r\nHost: localhost\r\n\r\n")
            client.recv(10)
    assert picture(page, "/left.jpg").shape == (480, 640, 3)
    with socket.create_connection(("127.0.0.1", page.port), timeout=5) as client:
        client.sendall(b"\x16\x03\x01 not a request at all\r\n\r\n")
        assert b"400" in client.recv(1000)
    assert capfd.readouterr() == ("", "")  # the terminal has a map to draw


def test_memory_is_bounded(page, chooser, pictures):
    for number in range(1, 40):
        state(page)
        chooser.choose(frame(number, pictures))
    assert len(page._looks) == live_page.LOOKS_KEPT
    seen = set()

    def size(thing):
        if id(thing) in seen:
            return 0
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            return thing.nbytes
        if isinstance(thing, dict):
            return sum(map(size, thing.values()))
        if isinstance(thing, list | tuple | bytes):
            return len(thing) if isinstance(thing, bytes) else sum(map(size, thing))
        return size(vars(thing)) if hasattr(thing, "__dict__") else 0

    assert sum(size(shown) for shown in page._looks) < live_page.LOOKS_KEPT * 2 * 800 * 600 * 3


def test_nothing_is_encoded_while_nobody_looks(page, chooser, pictures, monkeypatch):
    chooser.choose(frame(1, pictures))
    monkeypatch.setattr(live_page, "_jpeg", lambda picture: pytest.fail("nobody asked for a picture"))
    for number in range(2, 6):
        chooser.choose(frame(number, pictures))
    assert len(page._looks) == 0


def test_whoever_looks_hears_the_last_word(pictures, monkeypatch):
    monkeypatch.setattr(live_page, "LAST_WORD_S", 60)
    with LivePage(BOARD, port=0) as page:
        chooser = BoardChooser(BOARD, still=False, shows=[page.show])
        state(page)
        told = []

        def poll():
            while not told or told[-1]["number"] != 1:
                time.sleep(0.2)  # so that the last look comes between two questions
                told.append(state(page))

        client = threading.Thread(target=poll)
        client.start()
        chooser.choose(frame(1, pictures))
    client.join(10)
    assert not client.is_alive() and told[-1]["pairs"] == 1


def test_it_is_gone_when_closed(pictures):
    before = threading.active_count()
    with LivePage(BOARD, port=0) as page:
        state(page)
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.1", page.port), timeout=1).close()
    deadline = time.monotonic() + 10
    while threading.active_count() > before and time.monotonic() < deadline:
        time.sleep(0.02)
    assert threading.active_count() <= before
