import json
import struct

import cv2
import numpy as np
import pytest
import trimesh

from stereo_gpu.errors import InputError, PictureError
from stereo_gpu.export import write_glb
from stereo_gpu.model_files.glb_textures import CLAY
from stereo_gpu.read_model import read_glb
from stereo_gpu.types import Mesh

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
SQUARE_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # glTF: from the top left


@pytest.fixture
def mesh():
    rng = np.random.default_rng(4)
    return Mesh(
        vertices=rng.normal(0, 300, (40, 3)).astype(np.float32),
        faces=rng.integers(0, 40, (70, 3)).astype(np.int32),
        uv=rng.random((40, 2)).astype(np.float32),
        texture=rng.integers(0, 256, (9, 13, 3)).astype(np.uint8),
    )


def glb(path, document, binary=b"", *, version=2):
    text = json.dumps(document).encode() if isinstance(document, dict) else document
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", version, 12 + len(chunks)) + chunks)
    return path


def square(**more):
    """A document with one square of two triangles, and the bytes beside it."""
    indices = np.array([0, 1, 2, 0, 2, 3], np.uint16)
    _, png = cv2.imencode(".png", np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3))
    binary, views = b"", []
    for part in (CORNERS.tobytes(), SQUARE_UV.tobytes(), indices.tobytes(), png.tobytes()):
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(part)})
        binary += part + bytes(-len(part) % 4)
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
    }
    return document | more, binary


def test_our_own_file_comes_back_exactly(tmp_path, mesh):
    back = read_glb(write_glb(tmp_path / "model.glb", mesh))
    np.testing.assert_array_equal(back.vertices, (mesh.vertices * 1e-3).astype(np.float32))
    np.testing.assert_array_equal(back.faces, mesh.faces)
    np.testing.assert_array_equal(back.uv, mesh.uv)
    np.testing.assert_array_equal(back.texture, mesh.texture)
    assert back.unit == "m" and back.faces.dtype == np.int32 and back.vertices.dtype == np.float32
    # And what was read can be written and read again, now without any change.
    again = read_glb(write_glb(tmp_path / "again.glb", back))
    np.testing.assert_array_equal(again.vertices, back.vertices)


def test_nodes_move_turn_and_mirror(tmp_path):
    document, binary = square(
        scenes=[{"nodes": [0]}],
        nodes=[
            {"children": [1, 2], "translation": [0, 0, -5]},
            {"mesh": 0, "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)], "scale": [2, 1, 1]},
            {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
        ],
    )
    back = read_glb(glb(tmp_path / "two.glb", document, binary))
    # A quarter turn about z after x was doubled: (1, 1, 0) goes to (-1, 2, 0); camera axes flip y and z.
    np.testing.assert_allclose(back.vertices[2], [-1, -2, 5], atol=1e-6)
    np.testing.assert_allclose(back.vertices[4 + 2], [-1, -1, 5], atol=1e-6)
    a, b, c = (back.vertices[back.faces[:, corner]] for corner in range(3))
    # Every front still looks at the viewer, the mirrored one's, too.
    assert (np.cross(b - a, c - a)[:, 2] < 0).all()


def test_several_materials_share_a_sheet(tmp_path):
    document, binary = square()
    document["meshes"][0]["primitives"] += [
        {"attributes": {"POSITION": 0}, "indices": 2, "material": 1},
        {"attributes": {"POSITION": 0}, "indices": 2},
    ]
    document["materials"].append({"pbrMetallicRoughness": {"baseColorFactor": [1, 0.2122, 0, 1]}})
    back = read_glb(glb(tmp_path / "three.glb", document, binary))
    assert len(back.faces) == 6 and len(back.vertices) == 12
    height, width = back.texture.shape[:2]
    where = (back.uv * [width, height]).astype(int).clip(0, [width - 1, height - 1])
    seen = back.texture[where[:, 1], where[:, 0]]
    np.testing.assert_array_equal(seen[4:8], [[255, 127, 0]] * 4)  # 0.2122 of light is 127 in sRGB
    np.testing.assert_array_equal(seen[8:], [CLAY] * 4)
    # The picture's own texels, through the middle of each.
    u, v = np.meshgrid((np.arange(3) + 0.5) / 3, (np.arange(2) + 0.5) / 2)
    low, high = back.uv[:4].min(axis=0) * [width, height], back.uv[:4].max(axis=0) * [width, height]
    x, y = (low[0] + u * (high[0] - low[0])).astype(int), (low[1] + v * (high[1] - low[1])).astype(int)
    np.testing.assert_array_equal(back.texture[y, x], np.arange(18).reshape(2, 3, 3)[..., ::-1])


def test_pictures_that_repeat_are_laid_side_by_side(tmp_path):
    document, binary = square(samplers=[{"wrapS": 33648, "wrapT": 10497}], textures=[{"source": 0, "sampler": 0}])
    material = document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    material["extensions"] = {"KHR_texture_transform": {"scale": [2, 1], "offset": [-1, 3]}}
    back = read_glb(glb(tmp_path / "tiled.glb", document, binary))
    picture = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)[..., ::-1]
    np.testing.assert_array_equal(back.texture[2:-2, 2:-2], np.concatenate([picture[:, ::-1], picture], axis=1))
    material["extensions"]["KHR_texture_transform"]["scale"] = [20_000, 1]
    with pytest.raises(InputError, match="repeats a texture 20000 times"):
        read_glb(glb(tmp_path / "often.glb", document, binary))


@pytest.mark.parametrize(("mode", "faces"), [(5, [[0, 1, 2], [1, 3, 2]]), (6, [[1, 2, 0], [2, 3, 0]])])
def test_strips_and_fans(tmp_path, mode, faces):
    document, binary = square()
    document["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 0}, "mode": mode}]
    back = read_glb(glb(tmp_path / "m.glb", document, binary))
    np.testing.assert_array_equal(back.faces, faces)


def test_what_trimesh_writes(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.25)
    ball.apply_translation([0, 0, -2])
    ball.export(tmp_path / "ball.glb")
    back = read_glb(tmp_path / "ball.glb")
    np.testing.assert_allclose(back.vertices[back.faces], (ball.triangles * [1, -1, -1]), atol=1e-6)
    assert (back.texture == back.texture[0, 0]).all()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"meshes": []}, "is damaged"),
        ({"nodes": []}, "is damaged"),
        ({"nodes": [{}]}, "has no triangles"),
        ({"nodes": [{"children": [0]}]}, "stands in the scene twice"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}]}, "has no triangles"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": -1}}]}]}, "names accessors -1 of 3"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 1}}]}]}, "3 columns"),
        ({"meshes": 7}, "is damaged"),
        ({"buffers": [{"byteLength": 4, "uri": "model.bin"}]}, "needs the file 'model.bin'"),
        ({"images": [{"uri": "data:image/png;base64,AAAA"}]}, "cannot be decoded"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "needs KHR_draco_mesh_compression"),
        (
            {"accessors": [{"componentType": 5126, "count": 10**12, "type": "VEC3"}]},
            "holds sparse arrays",
        ),
        (
            {"accessors": [{"bufferView": 0, "componentType": 5126, "count": 10**12, "type": "VEC3"}]},
            "is damaged",
        ),
    ],
)
def test_documents_that_do_not_hold_together(tmp_path, change, reason):
    document, binary = square(**change)
    with pytest.raises((InputError, PictureError), match=reason) as caught:
        read_glb(glb(tmp_path / "model.glb", document, binary))
    assert "\n" not in str(caught.value) and "model.glb" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is no GLB"),
        (b"solid stl", "is no GLB"),
        (b"glTF\2\0\0\0", "is cut off"),
        (struct.pack("<4sII", b"glTF", 1, 20) + bytes(8), "version 1"),
        (struct.pack("<4sII", b"glTF", 2, 28) + struct.pack("<I4s", 8, b"JSON") + b"[" * 8, "JSON cannot be read"),
        (struct.pack("<4sII", b"glTF", 2, 28) + struct.pack("<I4s", 99, b"JSON") + b"[" * 8, "longer than the file"),
    ],
)
def test_files_that_are_no_glb(tmp_path, content, reason):
    path = tmp_path / "model.glb"
    path.write_bytes(content)
    with pytest.raises(InputError, match=reason):
        read_glb(path)


def test_paths_that_are_no_file(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_glb(tmp_path / "none.glb")
    with pytest.raises(InputError, match="is no file"):
        read_glb(tmp_path)


def test_damage_of_any_kind_is_one_line(tmp_path, mesh):
    """Bytes of a whole file changed or left out at random: it is read, or refused in one line."""
    whole = write_glb(tmp_path / "model.glb", mesh).read_bytes()
    rng = np.random.default_rng(7)
    path = tmp_path / "broken.glb"
    refused = 0
    for trial in range(300):
        data = bytearray(whole)
        for at in rng.integers(0, len(whole) if trial % 2 else 1800, 1 + trial % 4):
            data[at] = rng.integers(256) if trial % 3 else ord(rng.choice(list('0123456789-{}[],":')))
        path.write_bytes(data[: rng.integers(len(data))] if trial % 10 == 0 else data)
        try:
            read_glb(path)
        except InputError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 100


def test_a_part_that_is_shown_too_often(tmp_path, monkeypatch):
    monkeypatch.setattr("stereo_gpu.read_model.FACE_LIMIT", 1000)
    document, binary = square(scenes=[{"nodes": list(range(600))}], nodes=[{"mesh": 0}] * 600)
    with pytest.raises(InputError, match="more than 1000 triangles or vertices"):
        read_glb(glb(tmp_path / "many.glb", document, binary))


def test_textures_that_are_too_large_together(tmp_path, monkeypatch):
    monkeypatch.setattr("stereo_gpu.read_model.TEXEL_LIMIT", 11)  # two of 2 x 3 px are one too many
    document, binary = square()
    primitive = document["meshes"][0]["primitives"][0]
    document["meshes"][0]["primitives"].append(primitive | {"material": 1})
    one = document | {"meshes": [{"primitives": [primitive]}]}
    assert len(read_glb(glb(tmp_path / "one.glb", one, binary)).faces) == 2
    document["materials"].append(document["materials"][0])
    with pytest.raises(InputError, match="over 11 px of textures"):
        read_glb(glb(tmp_path / "two.glb", document, binary))


def places(value, path=()):
    """Every place in a document."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, below in inner:
        yield (*path, key)
        yield from places(below, (*path, key))


def test_documents_with_anything_anywhere(tmp_path):
    """Every place of a document left out and set to what does not belong there."""
    odd = [None, -1, 10**12, float("nan"), 1e300, "x", {}, [0]]
    document, binary = square(samplers=[{"wrapS": 33648, "wrapT": 10497}], textures=[{"source": 0, "sampler": 0}])
    document["nodes"][0] |= {"rotation": [0, 0, 0, 1], "scale": [2, 1, 1], "translation": [0, 0, -5]}
    surface = document["materials"][0]["pbrMetallicRoughness"]
    surface["baseColorFactor"] = [0.5, 1, 1, 1]
    surface["baseColorTexture"]["extensions"] = {"KHR_texture_transform": {"scale": [2, 1], "rotation": 0.1}}
    text = json.dumps(document)
    outcomes = set()
    for path in places(document):
        for change in ["leave out", *odd]:
            damaged = json.loads(text)
            *above, last = path
            place = damaged
            for key in above:
                place = place[key]
            if change == "leave out":
                del place[last]
            else:
                place[last] = change
            try:
                outcomes.add(read_glb(glb(tmp_path / "odd.glb", damaged, binary)).unit)
            except InputError as error:
                assert "\n" not in str(error)
                outcomes.add(str(error))
    assert "m" in outcomes and len(outcomes) > 40
