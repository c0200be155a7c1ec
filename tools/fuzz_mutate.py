"""Ways to damage a file: bits, bytes and ranges of any file; numbers, lines and nesting of texts; what .mat packs."""

import random
import re
import struct
import zlib

NUMBERS = (
    *(
        b"nan",
        b"NaN",
        b".Nan",
        b"inf",
        b"-inf",
        b".Inf",
        b"-.Inf",
        b"Infinity",
        b"1e999",
        b"-1e999",
        b"1e308",
        b"-1e308",
    ),
    *(
        b"-0",
        b"0",
        b"1",
        b"-1",
        b"2",
        b"3",
        b"4",
        b"5",
        b"8",
        b"12",
        b"14",
        b"0.5",
        b"1e5",
        b"1e-5",
        b"1e154",
        b"1e-320",
    ),
    *(b"4294967296", b"9" * 400, b"0x10", b"1_0", b"10:30", b"1,5", b"''", b"", b"true", b"null", b"[]", b"{}", b"[1]"),
    "\N{ARABIC-INDIC DIGIT ONE}".encode(),
)
WORDS = (
    *(b"&a ", b"*a", b"<<: *a", b"!!python/object:os.system ", b"!!binary ", b"!!opencv-matrix\n", b"? ", b"- ", b": "),
    *(b"---\n", b"...\n", b"%YAML 1.1\n", b"|\n", b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"&lt;", b"&#0;", b"<_>1</_>"),
    *(b"<![CDATA[1]]>", b"<!--", b"<?a?>", b"</", b"/>", b'"', b"'", b"[", b"]", b"{", b"}", b",", b";", b"\t", b"\r"),
    *(
        b"\0",
        b"\xff",
        b"\xef\xbb\xbf",
        b"\xff\xfe",
        b"#",
        b"=",
        b"unit: furlong\n",
        b"M1: 5\n",
        b"P2: 1\n",
        b"a: {b: 1}\n",
    ),
    *(b"<unit>m</unit>", b'"unit": "m",'),
)
NESTS = (b"[", b"{", b"<a>", b"- ", b"? ", b"{a: ", b'{"a":', b"a:\n ")


def mutate(chance: random.Random, data: bytes, others: list[bytes]) -> bytes:
    """`data` with one to five things done to it; `others` are files that pieces are taken from."""
    ways = VALUES if chance.random() < 0.5 else ANY  # what is no YAML any more says nothing of what comes after it
    for _ in range(1 + int(chance.expovariate(0.7)) % 5):
        packed = data[:6] == b"MATLAB" and chance.random() < 0.7
        data = (_inside if packed else chance.choice(ways))(chance, data, others)
    return data


def _place(chance: random.Random, data: bytes) -> int:
    return chance.randrange(len(data) + 1)


def _flip(chance: random.Random, data: bytes, _: list[bytes]) -> bytes:
    place = _place(chance, data[:-1])
    return data[:place] + bytes([data[place] ^ (1 << chance.randrange(8))]) + data[place + 1 :] if data else data


def _set(chance: random.Random, data: bytes, _: list[bytes]) -> bytes:
    place = _place(chance, data)
    return data[:place] + bytes([chance.randrange(256)]) + data[place + 1 :]


def _cut(chance: random.Random, data: bytes, _: list[bytes]) -> bytes:
    return data[: _place(chance, data)]


def _drop(chance: random.Random, data: bytes, _: list[bytes]) -> bytes:
    place = _place(chance, data)
    return data[:place] + data[place + chance.randint(1, 80) :]


def _repeat(chance: random.Random, data: bytes, _: list[bytes]) -> bytes:
    place, length = _place(chance, data), chance.randint(1, 200)
    return data[: place + length] + data[place:]


def _splice(chance: random.Random, data: bytes, others: list[bytes]) -> bytes:
    other = chance.choice(others)
    place, start = _place(chance, data), _place(chance, other)
    return data[:place] + other[start : start + chance.randint(1, 400)] + data[place + chance.choice((0, 0, 50)) :]


def _number(chance: random.Random, data: bytes, _: list[bytes]) -> bytes:
    """Put another number in place of one."""
    found = list(re.finditer(rb"-?\d[\d.]*(e[-+]?\d+)?", data))
    if not found:
        return data
    match = chance.choice(found)
    value = (
        chance.choice(NUMBERS)
        if chance.random() < 0.8
        else repr(chance.gauss(0, 10.0 ** chance.randint(-3, 6))).encode()
    )
    return data[: match.start()] + value + data[match.end() :]


def _line(chance: random.Random, data: bytes, _: list[bytes]) -> bytes:
    """Leave a line out, write it twice, or change places with another."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    one, other = chance.randrange(len(lines)), chance.randrange(len(lines))
    way = chance.randrange(3)
    if way == 0:
        del lines[one]
    elif way == 1:
        lines.insert(other, lines[one])
    else:
        lines[one], lines[other] = lines[other], lines[one]
    return b"".join(lines)


def _word(chance: random.Random, data: bytes, _: list[bytes]) -> bytes:
    place = _place(chance, data)
    if chance.random() < 0.5:  # at the beginning of a line, where most of them mean something
        place = data.rfind(b"\n", 0, place) + 1
    return data[:place] + chance.choice(WORDS) + data[place:]


def _nest(chance: random.Random, data: bytes, _: list[bytes]) -> bytes:
    place = _place(chance, data)
    count = chance.choice((2, 31, 33, 200, 5000, 50_000)) if chance.random() < 0.3 else 2
    return data[:place] + chance.choice(NESTS) * count + data[place:]


def _inside(chance: random.Random, data: bytes, others: list[bytes]) -> bytes:
    """Damage a variable of a .mat file, packed or not, and put it back with its length, mostly."""
    place, elements = 128, []
    while place + 8 <= len(data):
        kind, length = struct.unpack_from("<II", data, place)
        elements.append((kind, data[place + 8 : place + 8 + length]))
        place += 8 + length
    if not elements:
        return data
    number = chance.randrange(len(elements))
    kind, body = elements[number]
    if kind == 15:
        try:
            body = zlib.decompressobj().decompress(body, 200_000)
        except zlib.error:
            return data[: chance.randrange(len(data))]
    way = chance.randrange(6)
    if way == 0:
        body = _flip(chance, body[: min(len(body), 64)], others) + body[64:]  # flags, dimensions and name
    elif way == 1 and len(body) > 8:
        place = 8 * chance.randrange(len(body) // 8)
        value = struct.pack("<d", chance.choice((float("nan"), float("inf"), -1.0, 0.0, 1e308, 5.0, 640.5)))
        body = body[:place] + value + body[place + 8 :]
    elif way == 2 and len(body) > 8:
        place = 4 * chance.randrange(len(body) // 4)
        value = struct.pack(
            "<I", chance.choice((0, 1, 2, 4, 6, 9, 13, 14, 15, 16, 2**31 - 1, 2**32 - 1, chance.getrandbits(32)))
        )
        body = body[:place] + value + body[place + 4 :]
    elif way == 3:
        body = chance.choice((_cut, _repeat, _set, _splice))(chance, body, others)
    elif way == 4:
        body = b"\0" * chance.choice((10, 70_000, 1_000_000))
    elif way == 5:
        del elements[number]
    if way != 5:
        if kind == 15:
            if chance.random() < 0.7 and len(body) >= 8:  # with a length that fits, so that more than it is read
                body = body[:4] + struct.pack("<I", len(body) - 8) + body[8:]
            body = zlib.compress(body)
        elements[number] = (kind, body)
    return data[:128] + b"".join(struct.pack("<II", kind, len(body)) + body for kind, body in elements)


VALUES = (_number, _number, _number, _number, _line)
ANY = (_flip, _set, _cut, _drop, _repeat, _splice, _number, _number, _line, _word, _nest)
