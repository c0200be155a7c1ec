"""What hostile requests are made of: names, values, headers, and what is no HTTP at all."""

EDGE = b"edge-of-a-part"
TRICKS = (
    "../../../../etc/passwd",
    "..\\..\\token",
    "/etc/passwd",
    "C:\\windows\\x.png",
    "....//token",
    "%2e%2e%2ftoken",
    "a\0.png",
    "CON",
    ".",
    "..",
    "",
    "-rf",
    "$(id)",
    "`id`",
    "a;b\"c'd\r\nX: y",
    "\u202egnp.exe",
    "\ud83d\ude00".encode("utf-16", "surrogatepass").decode("utf-16") * 40,
    "ñ" * 3000,
    "left.png/../../../x",
    "\x1b]0;x\x07",
    "<script>alert(1)</script>",
    "' OR 1=1 --",
)
VALUES = (
    *("null", "true", "-1", "0", "1e999", "-1e999", "NaN", "Infinity", "9" * 400, "0.1", '""', '"auto"', "[]", "{}"),
    *(
        "[0,64]",
        "[22,40]",
        "[64,0]",
        "[1,2,3,4]",
        "[-5,-5,9,9]",
        "[1e9,1e9,1,1]",
        '"\\u0000"',
        '"\\ud800"',
        "[[]]",
        "4",
    ),
)
NAMES = (
    *("profile", "disparities", "window", "reference", "rectangle", "depth", "tile", "ignore_check", "check", "mesh"),
    *("files", "texture_format", "steps", "backend", "mask", "__class__", "__proto__", "progress", "rig", ""),
)


JUNK = (
    b"\x16\3\1\2\0\1\0\1\xfc\3\3" + bytes(200),
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(30),
    b"GET /\r\n\r\n",
    b"GET / HTTP/9.9\r\nHost: 127.0.0.1\r\n\r\n",
    b"GET / HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.0\r\n\r\n",
    b"\r\n" * 5000,
    bytes(70_000),
    b"USER anonymous\r\n",
    b"GET " + b"/" * 100_000,
)
HEADERS = (
    "Content-Length: 5",
    "Content-Length: -1",
    "Content-Length: 99999999999999999999",
    "Content-Length: 1e3",
    "Transfer-Encoding: chunked",
    "Transfer-Encoding: gzip, chunked",
    "Content-Encoding: gzip",
    "Host: example.com",
    "Authorization: Bearer x",
    "Authorization: Basic eDp5",
    "Content-Type: application/json",
    "Expect: 100-continue",
    "Expect: 200-ok",
    "Upgrade: websocket\r\nConnection: Upgrade",
    "Upgrade: h2c",
    "X: " + "y" * 1000,
    "X: " + "y" * 70_000,
    "\r\n".join(f"X-{n}: y" for n in range(2000)),
    *(f"Idempotency-Key: {key}" for key in ("", "x" * 300, "é", "\x01", "a b")),
    "X\0: y",
    " X: y",
    "X: y\r\n z",
    "Accept: nothing/at-all",
    "Accept-Encoding: gzip;q=x",
    "Cookie: " + "a=b;" * 900,
    "X-Forwarded-For: 1.2.3.4\r\nX-Forwarded-Host: evil.example\r\nX-Forwarded-Proto: gopher",
    *(f"Range: bytes={span}" for span in ("0-", "5-1", "-0", "-5", "0-0,5-6", "9" * 30 + "-", "x", "1-2-3")),
    *(f"If-None-Match: {tag}" for tag in ("*", '"', "W/" * 500, '"x", ' * 100)),
    *(f"Last-Event-ID: {name}" for name in ("-1", "9" * 40, "x")),
)
STROKES = (
    '{"rectangle":[60,40,200,150],"wanted":[{"radius":5,"points":[' + ",".join(["[160,120]"] * 9000) + "]}]}",
    "[" * 100_000,
    '{"wanted":' * 20_000,
    " " * 2_000_000,
    '"' + "x" * 900_000 + '"',
    "",
    "{}",
    "null",
    '{"rectangle":null}',
    "\ufeff{}",
)


def part(name: str, content: str | bytes, filename: str | None = None) -> bytes:
    """A part of a form, as a client writes it that quotes nothing."""
    named = "" if filename is None else f'; filename="{filename}"'
    head = f'Content-Disposition: form-data; name="{name}"{named}\r\n\r\n'.encode("utf-8", "surrogatepass")
    return head + (content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content)


def form(parts: list[bytes]) -> bytes:
    """A form of these parts."""
    return b"".join(b"--" + EDGE + b"\r\n" + one + b"\r\n" for one in parts) + b"--" + EDGE + b"--\r\n"
