"""Requests as nobody should send them; each follows from a seed and a number alone."""

import json
import random
from collections.abc import Callable
from dataclasses import dataclass, replace

from fuzz_mutate import mutate
from serve_fuzz_pictures import bombs, damage, others, seeds
from serve_fuzz_words import EDGE, HEADERS, JUNK, NAMES, STROKES, TRICKS, VALUES, form, part


@dataclass(frozen=True)
class Case:
    """What one connection says.

    Args:
        kind: of mistreatment.
        pieces: that are sent one after another.
        pause_s: between them.
        end: "read" what is answered; "half" closes our side first; "close" or "reset" the connection without reading.
        silence: whether no answer at all is one, too.
    """

    kind: str
    pieces: tuple[bytes, ...]
    pause_s: float = 0.0
    end: str = "read"
    silence: bool = False


@dataclass(frozen=True)
class World:
    """What the requests refer to.

    Args:
        token, other: of two clients.
        rig, job, outline: ids of the first one's.
        pictures: the left picture by format; right: the other one, a PNG.
        rig_files: calibration files.
    """

    token: str
    other: str
    rig: str
    job: str
    outline: str
    pictures: dict[str, bytes]
    right: bytes
    rig_files: tuple[bytes, ...]


class Cases:
    """All cases of a seed.

    Args:
        world: what they refer to.
        seed: of all of them.
        slow_s: between two drops of a slow client.
        hang: whether some clients stay without a word until they are cut off.
    """

    def __init__(self, world: World, seed: int, *, slow_s: float = 0.3, hang: bool = True) -> None:
        self._world, self._seed, self._slow_s, self._hang = world, seed, slow_s, hang
        self._bombs = tuple(bombs().values())
        self._others = tuple(others().values())
        self._kinds: tuple[tuple[int, Callable[[random.Random], Case]], ...] = (
            (5, self._whole),
            (22, self._picture),
            (10, self._bomb),
            (6, self._other),
            (14, self._form),
            (8, self._options),
            (8, self._trick),
            (10, self._path),
            (14, self._header),
            (6, self._strokes),
            (10, self._rig_file),
            (4, self._boards),
            (14, self._cut),
            (4, self._slow),
            (6, self._chunks),
            (4, self._no_http),
            (3, self._pipelined),
            (2, self._many),
        )

    @property
    def kinds(self) -> list[str]:
        """The names of all ways to mistreat."""
        return [maker.__name__.strip("_") for _, maker in self._kinds]

    def make(self, number: int) -> Case:
        """The case of a number."""
        chance = random.Random(f"{self._seed} {number}")
        weights, makers = zip(*self._kinds, strict=True)
        maker = chance.choices(makers, weights)[0]
        return replace(maker(chance), kind=maker.__name__.strip("_"))

    # -- requests as they should be

    def _request(self, method: str, path: str, body: bytes = b"", *headers: str, token: str | None = None) -> bytes:
        token = self._world.token if token is None else token
        lines = [
            f"{method} {path} HTTP/1.1",
            "Host: 127.0.0.1",
            f"Authorization: Bearer {token}",
            *([f"Content-Length: {len(body)}"] if body or method == "POST" else []),
            "Connection: close",
            *headers,
        ]
        return ("\r\n".join(lines) + "\r\n\r\n").encode("utf-8", "surrogateescape") + body

    def _post(self, path: str, parts: list[bytes], *headers: str) -> bytes:
        return self._request(
            "POST", path, form(parts), f"Content-Type: multipart/form-data; boundary={EDGE.decode()}", *headers
        )

    def _pair(
        self, left: bytes | None = None, right: bytes | None = None, options: str | bytes | None = None
    ) -> list[bytes]:
        world = self._world
        options = b'{"profile":"fast","disparities":[22,40],"check":"never"}' if options is None else options
        return [
            part("left", world.pictures["png"] if left is None else left, "left.png"),
            part("right", world.right if right is None else right, "right.png"),
            part("rig", world.rig),
            part("options", options),
        ]

    def _whole(self, chance: random.Random) -> Case:
        name = chance.choice(sorted(self._world.pictures))
        return Case("", (self._post("/v1/jobs", self._pair(self._world.pictures[name])),))

    # -- what is sent as a picture

    def _picture(self, chance: random.Random) -> Case:
        hurt = damage(chance, self._world.pictures[chance.choice(sorted(self._world.pictures))])
        return self._with_picture(chance, hurt)

    def _bomb(self, chance: random.Random) -> Case:
        return self._with_picture(chance, chance.choice(self._bombs))

    def _other(self, chance: random.Random) -> Case:
        return self._with_picture(chance, chance.choice(self._others))

    def _with_picture(self, chance: random.Random, picture: bytes) -> Case:
        if chance.random() < 0.15:
            return Case("", (self._post("/v1/outlines", self._pair(picture)[:3]),))
        parts = self._pair(picture) if chance.random() < 0.7 else [*self._pair(), part("mask", picture, "mask.png")]
        return Case("", (self._post("/v1/jobs", parts),))

    def _boards(self, chance: random.Random) -> Case:
        some = [self._world.right, damage(chance, self._world.right), chance.choice(self._bombs)]
        parts = [part(side, chance.choice(some), "x.png") for side in ("left", "right") * chance.choice((1, 3, 6))]
        words = ("10x7", "x", "0x0", "9" * 39, "4x4", "-3x5", "10×7")
        parts += [part("board", chance.choice(words)), part("square", chance.choice((*VALUES, "30")))]
        if chance.random() < 0.4:
            parts += [part("marker", chance.choice((*VALUES, "20"))), part("dictionary", chance.choice(TRICKS))]
        return Case("", (self._post("/v1/calibrations", parts),))

    def _rig_file(self, chance: random.Random) -> Case:
        files = [mutate(chance, chance.choice(self._world.rig_files), list(self._world.rig_files)) for _ in range(2)]
        parts = [part("file", data, chance.choice(TRICKS)) for data in files[: chance.choice((1, 1, 2))]]
        if chance.random() < 0.3:
            parts += [part("name", chance.choice(TRICKS)), part("size", chance.choice(TRICKS)), part("unit", "mm")]
        return Case("", (self._post("/v1/rigs", parts),))

    # -- the form around it

    def _form(self, chance: random.Random) -> Case:
        body = bytearray(form(self._pair(options=b"{}")))
        tokens = (
            b"",
            b"\r\n",
            b"\r\n\r\n",
            b"--" + EDGE,
            EDGE,
            b'"',
            b"\0",
            b"\xff",
            b";",
            b"=",
            b": ",
            b"--",
            b"\r",
            b"\n",
        )
        for _ in range(chance.choice((1, 2, 6))):
            places = [at for at in range(len(body)) if body.startswith(EDGE, at)] if chance.random() < 0.7 else [0]
            at = max(0, chance.choice(places) + chance.randrange(-10, 150))
            body[at : at + chance.choice((0, 1, 20))] = chance.choice(tokens)
        kinds = (f"multipart/form-data; boundary={EDGE.decode()}",) * 6 + (
            "multipart/form-data",
            "multipart/form-data; boundary=",
            'multipart/form-data; boundary="' + "x" * 300 + '"',
            "multipart/mixed; boundary=x",
            "application/json",
            "text/plain",
            "multipart/form-data; boundary=é",
        )
        path = chance.choice(("/v1/jobs", "/v1/rigs", "/v1/calibrations", "/v1/outlines"))
        return Case("", (self._request("POST", path, bytes(body), f"Content-Type: {chance.choice(kinds)}"),))

    def _options(self, chance: random.Random) -> Case:
        ways = (
            lambda: (
                "{" + ",".join(f"{json.dumps(chance.choice(NAMES))}:{chance.choice(VALUES)}" for _ in range(3)) + "}"
            ),
            lambda: (
                '{"mesh":{'
                + f'"{chance.choice(("faces", "error_px", "smoothing", "x"))}":{chance.choice(VALUES)}'
                + "}}"
            ),
            lambda: "[" * chance.choice((10, 1000, 16_000)),
            lambda: '{"a":' * 3000,
            lambda: '{"label":"' + "x" * chance.choice((100, 17_000, 300_000)) + '"}',
            lambda: damage(chance, b'{"profile":"fast","disparities":[22,40],"mesh":{"faces":500}}'),
            lambda: chance.choice(VALUES),
        )
        parts = self._pair(options=chance.choice(ways)())
        parts.append(part("label", chance.choice(TRICKS)))
        return Case("", (self._post("/v1/jobs", parts),))

    def _trick(self, chance: random.Random) -> Case:
        def trick() -> str:
            return chance.choice(TRICKS)

        pair = self._pair()
        ways = (
            lambda: [
                part("left", self._world.pictures["png"], trick()),
                part("right", self._world.right, trick()),
                *pair[2:],
            ],
            lambda: [*pair[:2], part("rig", trick())],
            lambda: [part(trick(), self._world.right, "x.png"), *pair],
            lambda: [*pair, part(chance.choice(("left", "rig", "options", "mask")), trick(), trick())],
        )
        return Case("", (self._post("/v1/jobs", chance.choice(ways)(), f"Idempotency-Key: {chance.randrange(20)}"),))

    def _many(self, chance: random.Random) -> Case:
        name = chance.choice(("left", "x", "label", "file"))
        path = chance.choice(("/v1/jobs", "/v1/calibrations", "/v1/rigs"))
        return Case("", (self._post(path, [part(name, b"x")] * chance.choice((500, 3000))),))

    # -- the rest of HTTP

    def _path(self, chance: random.Random) -> Case:
        world = self._world
        trick = chance.choice(TRICKS).encode("utf-8", "surrogatepass")
        quoted = "".join(f"%{letter:02x}" for letter in trick[:500])
        raw = "".join(chr(letter) for letter in trick[:500] if 33 <= letter < 127)
        path = chance.choice(
            (
                f"/v1/jobs/{world.job}/files/{quoted}",
                f"/v1/jobs/{world.job}/files/{raw}",
                f"/v1/jobs/{world.job}/inputs/{quoted}",
                f"/v1/jobs/{world.job}/steps/{quoted}",
                f"/v1/jobs/{quoted}/files",
                f"/v1/jobs/{world.job}/../{world.job}",
                f"/v1/rigs/{quoted}/file",
                f"/v1/outlines/{quoted}/picture",
                f"/page/{quoted}",
                f"/page/{raw}",
                f"//{raw}",
                f"/v1/jobs?limit={quoted}&after={raw}&state={quoted}",
                f"/v1/jobs?limit={chance.choice(VALUES)[:50]}&after={chance.choice(('-1', '9' * 30, '1'))}",
                f"/v1/jobs/{world.job}/{chance.choice(('cancel', 'restart', 'events', 'files', 'x'))}",
                f"/v1/jobs/{'0' * chance.choice((31, 32, 33))}",
                "/" + "a" * chance.choice((100, 40_000)),
                "http://example.com/healthz",
                "*",
                "/%",
                "/%zz%ff%fe",
                "/v1/jobs/%0d%0aX-Y: z",
            )
        )
        method = chance.choice(
            ("GET",) * 6 + ("POST", "DELETE", "PUT", "PATCH", "HEAD", "OPTIONS", "TRACE", "CONNECT", "X")
        )
        if method == "DELETE":  # not what others refer to
            path = path.replace(world.job, "0" * 32)
        token = chance.choice((world.token, world.token, world.other, "", "x" * 9000))
        return Case("", (self._request(method, path, token=token),))

    def _header(self, chance: random.Random) -> Case:
        job = self._world.job
        header = chance.choice(HEADERS)
        request = chance.choice(
            (
                self._post("/v1/jobs", self._pair(), header),
                self._request("GET", f"/v1/jobs/{job}/files/model.glb", b"", header),
                self._request("GET", f"/v1/jobs/{job}/events", b"", header),
                self._request("GET", "/v1/jobs", b"", header),
                self._request("POST", f"/v1/outlines/{self._world.outline}/mask", b"{}", header),
            )
        )
        # With two lengths, or more promised than sent, what follows is a client that waits.
        return Case("", (request,), end="half" if chance.random() < 0.5 else "read", silence=True)

    def _strokes(self, chance: random.Random) -> Case:
        numbers = ("1", "-1", "1e9", "1e999", "NaN", "null", '"a"', "[]", "0.5", "9" * 400)
        point = f"[{chance.choice(numbers)},{chance.choice(numbers)}]"
        stroke = f'{{"radius":{chance.choice(numbers)},"points":[{point}]}}'
        body = chance.choice(
            (
                f'{{"rectangle":[{",".join(chance.choices(numbers, k=4))}],"wanted":[{stroke}],"unwanted":[]}}',
                f'{{"rectangle":[60,40,200,150],"wanted":[{stroke}],"unwanted":[{stroke}]}}',
                *STROKES,
            )
        )
        path = f"/v1/outlines/{self._world.outline}/mask"
        return Case("", (self._request("POST", path, body.encode(), "Content-Type: application/json"),))

    def _cut(self, chance: random.Random) -> Case:
        request = self._whole(chance).pieces[0]
        at = chance.randrange(len(request)) if chance.random() < 0.6 else chance.randrange(400)
        ends = ("half", "close", "reset") * 4 + (("read",) if self._hang else ())
        return Case("", (request[:at],), end=chance.choice(ends), silence=True)

    def _slow(self, chance: random.Random) -> Case:
        request = self._whole(chance).pieces[0]
        start = chance.choice((0, 30, 700))
        drops = tuple(request[at : at + 1] for at in range(start, start + chance.choice((5, 20))))
        rest = (request[start + len(drops) :],) if chance.random() < 0.6 else ()
        end = "read" if rest or self._hang else "half"
        return Case("", (request[:start], *drops, *rest), pause_s=self._slow_s, end=end, silence=True)

    def _chunks(self, chance: random.Random) -> Case:
        head, _, body = self._whole(chance).pieces[0].partition(b"\r\n\r\n")
        lines = [line for line in head.split(b"\r\n") if not line.startswith(b"Content-Length")]
        size = chance.choice((1, 50, 5000, 1 << 20))
        body = body[: 5000 * size]
        chunks = [
            b"%x\r\n%s\r\n" % (len(one), one) for one in (body[at : at + size] for at in range(0, len(body), size))
        ]
        if chance.random() < 0.5:
            chunks[chance.randrange(len(chunks))] = chance.choice(
                (
                    b"-5\r\nhello\r\n",
                    b"ffffffffffffffff\r\nx\r\n",
                    b"zz\r\n",
                    b"5;" + b"x" * 50_000,
                    b"5\r\nhelloX\r\n",
                    b"",
                )
            )
        last = chance.choice((b"0\r\n\r\n", b"0\r\n\r\n", b"", b"0\r\nX: y\r\n\r\n"))
        sent = b"\r\n".join((*lines, b"Transfer-Encoding: chunked", b"", b"")) + b"".join(chunks) + last
        return Case("", (sent,), end="half" if not last else "read", silence=True)

    def _no_http(self, chance: random.Random) -> Case:
        sent = chance.choice((*JUNK, chance.randbytes(2000)))
        return Case("", (sent,), end=chance.choice(("half", "reset", "half")), silence=True)

    def _pipelined(self, chance: random.Random) -> Case:
        stay = self._request("GET", "/healthz").replace(b"Connection: close\r\n", b"")
        last = chance.choice((self._request("GET", "/v1/jobs"), self._whole(chance).pieces[0], b"junk\r\n\r\n"))
        return Case("", (stay * chance.choice((2, 50)) + last,))


def world_of(
    token: str, other: str, rig: str, job: str, outline: str, left: bytes, right: bytes, rigs: list[bytes]
) -> World:
    """A world around one pair."""
    return World(token, other, rig, job, outline, seeds(left), right, tuple(rigs))
