"""Options of a job as JSON: taken as `reconstruct` takes them, refused in the command line's words."""

import json
import math
from dataclasses import fields

import pytest
from conftest import need_service

from stereo_gpu.config import MeshOptions
from stereo_gpu.errors import InputError
from stereo_gpu.service.records import InputFile

need_service_here = pytest.fixture(scope="module", autouse=True)(need_service)


def read(given, **more):
    from stereo_gpu.service.options import read_options

    return read_options(given, **more)


def test_nothing_given_is_what_reconstruct_does_by_itself():
    options = read("")
    assert options == read("{}") == read({})
    assert options.given() == {}
    assert options.keywords()["mesh"] == MeshOptions()
    assert (options.check, options.files, options.texture_format, options.steps) == ("first", "model", "png", False)


def test_the_defaults_of_a_mesh_are_those_of_the_library():
    from stereo_gpu.service.options import MeshJson

    ours = MeshJson().model_dump()
    assert ours == {field.name: field.default for field in fields(MeshOptions) if field.name != "unwrap_seconds"}


def test_all_options_reach_reconstruct():
    given = {
        "profile": "fast",
        "disparities": [40, 64],
        "window": "auto",
        "reference": "left",
        "rectangle": [1, 2, 30, 40],
        "depth": [None, 900],
        "tile": 100,
        "ignore_check": True,
        "check": "rows",
        "mesh": {"faces": 2000, "unwrap": "view", "largest_hole": None},
        "files": "all",
        "texture_format": "jpeg",
        "steps": True,
    }
    options = read(json.dumps(given), width=640)
    assert options.keywords() == {
        "profile": "fast",
        "disparities": (40, 64),
        "window": "auto",
        "reference": "left",
        "rectangle": (1, 2, 30, 40),
        "depth": (0.0, 900.0),
        "tile": 100,
        "ignore_check": True,
        "mesh": MeshOptions(faces=2000, unwrap="view", largest_hole=None),
    }
    assert read('{"depth": [5, null]}').keywords()["depth"] == (5.0, math.inf)
    # The table keeps them as JSON, and they come back.
    assert read(json.loads(json.dumps(options.given()))) == options


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ('{"profile": "quick"}', "profile = 'quick': it must be one of paper, fast, precise"),
        ('{"window": 4}', "window = 4: it must be odd and from 3 to 31, or auto"),
        ('{"window": true}', 'window = true: give the side of a square in px, odd, 3 to 31, "auto", or null'),
        ('{"window": "auto", "profile": "paper"}', "window = auto: profile paper has one window"),
        ('{"disparities": [5]}', 'disparities = [5]: give "auto" or [smallest, how many], px'),
        ('{"disparities": [0, 1.5]}', 'disparities = [0, 1.5]: give "auto" or'),
        ('{"disparities": [0, 0]}', "disparities = (0, 0) is an empty range"),
        ('{"disparities": [640, 4]}', "disparities = (640, 4) lies outside of a picture 640 px wide"),
        ('{"disparities": [0, 9999]}', "at most 8192 can be searched"),
        ('{"depth": [9, 3]}', "depth = 9,3: give the nearest depth"),
        ('{"depth": [NaN, 3]}', "depth = NaN: give [nearest, farthest]"),
        ('{"depth": [1e999, 3]}', "depth = Infinity: give [nearest, farthest]"),
        ('{"rectangle": [1, 2, 3]}', "rectangle = [1, 2, 3]: give [x, y, width, height], px"),
        ('{"reference": "top"}', "reference = 'top': it must be left or right"),
        ('{"tile": 3}', "tile = 3: it must be 16 px or more"),
        ('{"tile": 1e30}', "tile = 1e+30: "),
        ('{"mesh": {"faces": -1}}', "faces = -1: give how many triangles to keep"),
        ('{"mesh": {"faces": "9"}}', 'mesh.faces = "9": input should be a valid integer'),
        ('{"mesh": {"error_px": Infinity}}', "mesh.error_px = Infinity: input should be a finite number"),
        ('{"mesh": {"unwrap_seconds": 9}}', "option 'mesh.unwrap_seconds' is unknown: give any of method, error_px"),
        ('{"mesh": []}', "mesh = []: input should be"),
        ('{"texture_format": "gif"}', "texture format 'gif' is unknown: choose png, jpeg, webp"),
        ('{"files": "some"}', "files = \"some\": input should be 'model' or 'all'"),
        ('{"check": "often"}', "check = \"often\": input should be 'first', 'full', 'rows' or 'never'"),
        ('{"steps": 1}', "steps = 1: input should be a valid boolean"),
        ('{"backend": "warp:cpu"}', "option 'backend' is unknown: give any of profile, disparities"),
        ('{"mask": "/etc/passwd"}', "option 'mask' is unknown"),
        ("[]", "options = []: input should be an object"),
        ("1", "options = 1: input should be an object"),
        ("{", "options are no JSON: "),
        ("no", "options are no JSON: "),
        (b'{"profile": "\xff"}', "options are no JSON: "),
        ('{"a":' * 5000, "options are no JSON: recursion limit"),
        ("[" * 16_000, "options are no JSON: recursion limit"),
        ('{"' + "y" * 10_000 + '": 1}', "is unknown: give any of"),
        ('{"profile": "' + "y" * 10_000 + '"}', 'profile = "yyy'),
        ('{"steps": [' + "0," * 5000 + "0]}", "steps = [0, 0, 0"),
        ('{"tile": ' + "9" * 3000 + "}", "tile = "),
        ('{"pr\\nofile": "\\u0000\\n"}', "option 'pr\\nofile' is unknown"),
    ],
)
def test_wrong_ones_are_refused_in_a_line(given, line):
    with pytest.raises(InputError) as refused:
        read(given, width=640)
    assert line in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 400


def test_a_fingerprint_tells_requests_apart():
    from stereo_gpu.service.options import fingerprint

    def picture(name, sha256, given="a.png"):
        return InputFile(name=name, given=given, sha256=sha256, size=1, width=9, height=9)

    one = fingerprint({"rig": "r", "options": {"a": 1, "b": 2}}, [picture("left.png", "1"), picture("right.png", "2")])
    assert one == fingerprint(
        {"options": {"b": 2, "a": 1}, "rig": "r"},
        [picture("left.png", "1", given="b.png"), picture("right.png", "2")],
    )
    others = [
        fingerprint({"rig": "q", "options": {"a": 1, "b": 2}}, [picture("left.png", "1"), picture("right.png", "2")]),
        fingerprint({"rig": "r", "options": {"a": 1, "b": 3}}, [picture("left.png", "1"), picture("right.png", "2")]),
        fingerprint({"rig": "r", "options": {"a": 1, "b": 2}}, [picture("left.png", "2"), picture("right.png", "1")]),
        fingerprint({"rig": "r", "options": {"a": 1, "b": 2}}, [picture("left.png", "1")]),
    ]
    assert len({one, *others}) == 5
