"""Forms received piece by piece: what is taken lies whole on the disk, what is not leaves nothing behind."""

import asyncio
import hashlib
import random

import pytest
from conftest import need_service

from stereo_gpu.errors import InputError
from stereo_gpu.service.settings import MEGABYTE, Settings

need_service_here = pytest.fixture(scope="module", autouse=True)(need_service)
RIG = b"0" * 32


@pytest.fixture(scope="module")
def pictures(raw_folder):
    return {side: (raw_folder / f"{side}.png").read_bytes() for side in ("left", "right")}


@pytest.fixture
def folders(tmp_path):
    from stereo_gpu.service.data.folders import Folders

    folders = Folders(tmp_path / "data")
    with folders.own():
        yield folders


def part(name, content, filename=None, extra=b""):
    named = b"" if filename is None else b'; filename="' + filename.encode() + b'"'
    return b'Content-Disposition: form-data; name="' + name.encode() + b'"' + named + extra + b"\r\n\r\n" + content


def form_of(*parts, boundary=b"edge"):
    return b"".join(b"--" + boundary + b"\r\n" + one + b"\r\n" for one in parts) + b"--" + boundary + b"--\r\n"


def pair_form(pictures):
    files = [part(side, data, f"{side}.png") for side, data in pictures.items()]
    return form_of(*files, part("rig", RIG))


def receive(folders, pieces, *, kind="multipart/form-data; boundary=edge", headers=(), pause=0.0, **settings):
    """What `receive_form` makes of pieces of a body; after the last comes the end, or a lost connection for None."""
    from fastapi import Request

    from stereo_gpu.service.intake.multipart import FileWanted, FormSpec
    from stereo_gpu.service.intake.uploads import receive_form

    wanted = FormSpec(
        files={"left": FileWanted(), "right": FileWanted(), "more": FileWanted(least=0, most=3, picture=False)},
        fields={"rig": 32, "label": 10},
        required=("rig",),
    )
    settings = Settings(**{"data": folders.root, "spare_gb": 0.0, **settings})
    scope = {
        "type": "http",
        "method": "POST",
        "path": "/",
        "query_string": b"",
        "headers": [(b"content-type", kind.encode()), *headers],
    }
    left = list(pieces)

    async def give():
        if not left:
            return {"type": "http.request", "body": b"", "more_body": False}
        await asyncio.sleep(pause)
        piece = left.pop(0)
        if piece is None:
            return {"type": "http.disconnect"}
        return {"type": "http.request", "body": piece, "more_body": True}

    return asyncio.run(receive_form(Request(scope, give), folders, settings, wanted))


def uploads(folders):
    return sorted(folders.uploads.iterdir())


@pytest.mark.parametrize("piece", [1, 7, 1000, 1 << 30])
def test_a_form_is_the_same_in_any_pieces(piece, folders, pictures):
    if piece == 1:  # one by one, of small files
        pictures = {side: b"P5 3 3 255\n" + side[:1].encode() * 9 for side in ("left", "right")}
    body = pair_form(pictures)
    with receive(folders, [body[at : at + piece] for at in range(0, len(body), piece)]) as form:
        assert form.fields == {"rig": RIG.decode()}
        assert [file.given for file in form.inputs] == ["left.png", "right.png"]
        for file, data in zip(form.inputs, pictures.values(), strict=True):
            assert form.path(file).read_bytes() == data
            assert (file.sha256, file.size) == (hashlib.sha256(data).hexdigest(), len(data))
        assert form.bytes == sum(map(len, pictures.values()))
        assert sorted(path.name for path in form.folder.iterdir()) == sorted(file.name for file in form.inputs)
        assert uploads(folders) == [form.folder]
    assert uploads(folders) == []


def test_what_is_kept_stays(folders, pictures):
    with receive(folders, [pair_form(pictures)]) as form:
        folders.accept(form.folder, "a" * 32)
        form.keep()
    assert sorted(path.name for path in folders.inputs("a" * 32).iterdir()) == ["left.png", "right.png"]
    assert uploads(folders) == []


def test_names_are_the_servers(folders, pictures):
    names = ["../../left.png", "C:\\evil\\right.png"]
    files = [part(side, data, name) for (side, data), name in zip(pictures.items(), names, strict=True)]
    given = ("/etc/passwd", "...", "x\x00y\x1b[2J" + "z" * 300)
    more = [part("more", b"a", name) for name in given]
    with receive(folders, [form_of(*files, *more, part("rig", RIG))]) as form:
        assert [file.name for file in form.inputs] == ["left.png", "right.png", "more000", "more001", "more002"]
        assert [file.given for file in form.inputs[:4]] == ["left.png", "right.png", "passwd", "..."]
        assert form.inputs[4].given == "xy[2J" + "z" * 95
        assert [path.parent for path in form.folder.rglob("*")] == [form.folder] * 5


def test_a_file_is_named_by_what_it_is(folders, pictures):
    import cv2
    import numpy as np

    jpeg = cv2.imencode(".jpg", cv2.imdecode(np.frombuffer(pictures["left"], np.uint8), 1))[1].tobytes()
    body = form_of(part("left", jpeg, "left.png"), part("right", jpeg, "right.exe"), part("rig", RIG))
    with receive(folders, [body]) as form:
        assert [file.name for file in form.inputs] == ["left.jpg", "right.jpg"]
        assert {(file.width, file.height) for file in form.inputs} == {(320, 240)}


LEFT = part("left", b"P5 3 3 255\n" + bytes(9))
RIGHT = part("right", b"P5 3 3 255\n" + bytes(9))
ID = part("rig", RIG)


@pytest.mark.parametrize(
    ("body", "line"),
    [
        (form_of(LEFT, ID), "right is missing: send 1 file of that name"),
        (form_of(LEFT, RIGHT), "rig is missing: give it"),
        (form_of(LEFT, LEFT, RIGHT, ID), "left has over 1 file: send no more than that"),
        (form_of(LEFT, RIGHT, ID, ID), "rig is given twice: give it once"),
        (form_of(LEFT, part("../x", b"")), "'../x' is no field of this form: send left, right, more, rig, label"),
        (form_of(LEFT, RIGHT, part("rig", b"\xff\xfe")), "rig is no UTF-8: send it as UTF-8"),
        (form_of(LEFT, part("right", b"", "b.png"), ID), "right (b.png) is empty: send it again"),
        (form_of(LEFT, part("right", b"MZ\x90"), ID), "right is no picture of a format that is taken: send PNG, JPEG"),
        (form_of(LEFT, part("right", b"P5 9999999 99999 255\n"), ID), "right says it is 9999999 x 99999 px, the limit"),
        (form_of(), "rig is missing: give it"),
        (form_of(LEFT, RIGHT, part("rig", RIG + b"0")), "rig has over 32 bytes: shorten it"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(body, line, folders):
    with pytest.raises(InputError) as refused:
        receive(folders, [body])
    assert str(refused.value).startswith(line)
    assert uploads(folders) == []


@pytest.mark.parametrize(
    ("body", "status", "line"),
    [
        (b"", 400, "the form is cut off: send it again"),
        (form_of(LEFT, RIGHT, ID)[:-30], 400, "the form is cut off"),
        (b"hello", 400, "the form is damaged: "),
        (b"--edge\r\nContent Disposition: x\r\n\r\n", 400, "the form is damaged: "),
        (b"--edge\r\nX: y\r\n\r\nz\r\n--edge--\r\n", 400, "a part of the form has no name"),
        (b"--edge\r\nContent-Disposition: attachment; name=left\r\n\r\n", 400, "a part of the form has no name"),
        (form_of(part("left", b"aGk=", extra=b"\r\nContent-Transfer-Encoding: base64")), 400, "a part of the form is"),
        (form_of(part("left", b"", extra=b"\r\nContent-Disposition: form-data; name=rig")), 400, "a part has"),
        (b"--edge\r\nX: " + b"y" * 5000 + b"\r\n\r\n", 400, "the "),
        (b"--edge\r\n" + b"".join(b"X%d: y\r\n" % n for n in range(900)), 400, "the "),
        (form_of(part("left", bytes(MEGABYTE + 1))), 413, "left is larger than 1 MB, which is the limit here"),
        (form_of(part("left", bytes(MEGABYTE)), part("right", bytes(MEGABYTE))), 413, "the request is larger"),
    ],
)
def test_what_is_no_form_or_too_large_has_its_status(body, status, line, folders):
    from stereo_gpu.service.problems import Problem

    with pytest.raises(Problem) as refused:
        receive(folders, [body[at : at + 65536] for at in range(0, len(body), 65536)], file_mb=1, request_mb=2)
    assert (refused.value.status, str(refused.value)[: len(line)]) == (status, line)
    assert "\n" not in str(refused.value)
    assert uploads(folders) == []


@pytest.mark.parametrize(
    ("kind", "headers", "status", "line"),
    [
        ("application/json", [], 415, "the body is of type 'application/json': send multipart/form-data"),
        ("", [], 415, "the body is of type '': send multipart/form-data"),
        ("multipart/form-data", [], 400, "the form has a boundary of 0 characters"),
        ("multipart/form-data; boundary=" + "x" * 71, [], 400, "the form has a boundary of 71 characters"),
        ("multipart/form-data; boundary=edge", [(b"content-encoding", b"gzip")], 415, "content-encoding 'gzip'"),
        ("multipart/form-data; boundary=edge", [(b"content-length", b"9" * 19)], 413, "the request is larger"),
    ],
)
def test_nothing_is_read_of_what_cannot_be_taken(kind, headers, status, line, folders):
    from stereo_gpu.service.problems import Problem

    with pytest.raises(Problem, match=line) as refused:
        receive(folders, [None], kind=kind, headers=headers)
    assert refused.value.status == status
    assert uploads(folders) == []


def test_slow_clients_are_told_so(folders, pictures):
    from stereo_gpu.service.problems import Problem

    body = pair_form(pictures)
    with pytest.raises(Problem, match=r"^nothing came for 0\.05 s: send the request again$") as refused:
        receive(folders, [body], pause=5, idle_seconds=0.05)
    assert refused.value.status == 408
    pieces = [body[at : at + 10] for at in range(0, len(body), 10)]
    with pytest.raises(Problem, match=r"^the request took over 0\.2 s: send less, or over a faster line$") as refused:
        receive(folders, pieces, pause=0.02, upload_seconds=0.2)
    assert refused.value.status == 408
    assert uploads(folders) == []


def test_a_lost_connection_leaves_nothing(folders, pictures):
    from stereo_gpu.service.problems import Problem

    body = pair_form(pictures)
    with pytest.raises(Problem, match="the connection was lost"):
        receive(folders, [body[:5000], None])
    assert uploads(folders) == []


def test_a_full_disk_is_507(folders, pictures):
    from stereo_gpu.service.problems import Problem

    with pytest.raises(Problem, match="the disk of the service is full") as refused:
        receive(folders, [pair_form(pictures)], spare_gb=1e9)
    assert refused.value.status == 507
    assert uploads(folders) == []


@pytest.mark.parametrize("after", range(1, 6))
def test_a_cancelled_request_leaves_nothing(after, folders, pictures):
    with pytest.raises(asyncio.CancelledError):
        _cancelled(folders, pair_form(pictures), after)
    assert uploads(folders) == []


def _cancelled(folders, body, after):
    """Received until `after` pieces of it have come, then cancelled while the next is awaited."""
    from fastapi import Request

    from stereo_gpu.service.intake.multipart import FileWanted, FormSpec
    from stereo_gpu.service.intake.uploads import receive_form

    scope = {
        "type": "http",
        "method": "POST",
        "path": "/",
        "query_string": b"",
        "headers": [(b"content-type", b"multipart/form-data; boundary=edge")],
    }
    pieces = [body[at : at + len(body) // 5] for at in range(0, len(body), len(body) // 5)]

    async def run():
        came = asyncio.Event()
        given = 0

        async def give():
            nonlocal given
            if given == after:
                came.set()
                await asyncio.sleep(60)
            given += 1
            return {"type": "http.request", "body": pieces[given - 1], "more_body": True}

        wanted = FormSpec(files={"left": FileWanted(), "right": FileWanted()}, fields={"rig": 32})
        settings = Settings(data=folders.root, spare_gb=0.0)
        task = asyncio.create_task(receive_form(Request(scope, give), folders, settings, wanted))
        await came.wait()
        task.cancel()
        await task

    asyncio.run(run())


DAMAGE = (b"", b"\r\n", b"--edge", b'"', b"\0", b"\xff", b";", b"=", b"\r", b"--")


def test_damaged_forms_raise_nothing_else(folders, pictures):
    from stereo_gpu.service.problems import Problem

    small = {side: b"P5 3 3 255\n" + bytes(9) for side in ("left", "right")}
    whole = pair_form(small)
    chance = random.Random(7)
    said = set()
    for _ in range(300):
        body = bytearray(whole[: chance.choice((len(whole), chance.randrange(len(whole))))])
        for _ in range(chance.randrange(6)):
            at = chance.randrange(len(body) + 1)
            cut = chance.choice((0, 1, 5))
            body[at : at + cut] = chance.choice(DAMAGE)
        cuts = sorted(chance.randrange(len(body) + 1) for _ in range(3))
        pieces = [bytes(body[a:b]) for a, b in zip([0, *cuts], [*cuts, len(body)], strict=True)]
        try:
            with receive(folders, [piece for piece in pieces if piece]) as form:
                said.add(len(form.inputs))
        except Problem as problem:
            assert problem.status in (400, 413)
            said.add(str(problem)[:30])
        except InputError as error:
            assert "\n" not in str(error)
            said.add(str(error)[:30])
        assert uploads(folders) == []
    assert len(said) > 8
