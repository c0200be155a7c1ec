"""Network cameras for tests: a process that serves MJPEG streams over HTTP, and pictures that tell their number.

    python tests/camera_server.py PORT

serves /NAME?fps=20&late_ms=0&lost=5-9&stall=40: pictures numbered by the computer's clock, so that all streams and
later runs agree on what is when. `late_ms` delays all of them, `lost` leaves out numbers modulo 30, `stall` stops
for ever after so many. A picture shows its number as 16 black or white squares, the lowest bit first.
"""

import re
import subprocess
import sys
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np

BITS = 16
CYCLE = 30  # pictures, after which the same ones are lost again
SIZE = (160, 120)  # px
BOUNDARY = b"picture"


def numbered(number, size=SIZE):
    """(H, W, 3) uint8, BGR, with its number in two rows of squares."""
    width, height = size
    picture = np.full((height, width, 3), 96, np.uint8)
    side = width // (BITS // 2)
    for bit in range(BITS):
        row, column = divmod(bit, BITS // 2)
        value = 255 if number >> bit & 1 else 0
        picture[row * side : (row + 1) * side, column * side : (column + 1) * side] = value
    return picture


def number_of(picture):
    """The number that a picture shows, however it was coded and scaled."""
    side = picture.shape[1] // (BITS // 2)
    number = 0
    for bit in range(BITS):
        row, column = divmod(bit, BITS // 2)
        block = picture[row * side : (row + 1) * side, column * side : (column + 1) * side]
        number |= int(block[side // 4 : -side // 4, side // 4 : -side // 4].mean() > 128) << bit
    return number


class Cameras:
    """Network cameras: a process of its own, which can be killed and started again."""

    def __init__(self):
        self.port = 0
        self.start()

    def start(self):
        arguments = [sys.executable, __file__, str(self.port)]
        self._process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
        self.port = int(self._process.stdout.readline())

    def die(self):
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()

    def url(self, side, **options):
        return f"http://127.0.0.1:{self.port}/{side}?" + "&".join(f"{name}={value}" for name, value in options.items())


class Camera(BaseHTTPRequestHandler):
    def do_GET(self):
        asked = {name: values[0] for name, values in parse_qs(urlsplit(self.path).query).items()}
        fps = float(asked.get("fps", 20))
        late_s = float(asked.get("late_ms", 0)) / 1000
        lost = range(*map(int, re.split("-", asked["lost"]))) if "lost" in asked else range(0)
        stall = int(asked.get("stall", 10**9))
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY.decode()}")
        self.end_headers()
        number, sent = int(time.monotonic() * fps), 0
        try:
            while True:
                number += 1
                time.sleep(max(0.0, number / fps + late_s - time.monotonic()))
                if sent >= stall:
                    time.sleep(3600)
                if number % CYCLE in lost:
                    continue
                _, jpeg = cv2.imencode(".jpg", numbered(number % 2**BITS))
                head = b"--%s\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % (BOUNDARY, len(jpeg))
                self.wfile.write(head + jpeg.tobytes() + b"\r\n")
                self.wfile.flush()
                sent += 1
        except OSError:  # whoever looked has gone
            pass

    def log_message(self, *_):
        pass


if __name__ == "__main__":
    ThreadingHTTPServer.daemon_threads = True
    ThreadingHTTPServer.allow_reuse_address = True
    server = ThreadingHTTPServer(("127.0.0.1", int(sys.argv[1])), Camera)
    print(server.server_address[1], flush=True)
    server.serve_forever()
