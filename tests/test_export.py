import base64
import json
import struct
import xml.etree.ElementTree as ElementTree

import cv2
import numpy as np
import pytest
import trimesh

from stereo_gpu.errors import InputError
from stereo_gpu.export import (
    export_model,
    read_pfm,
    write_glb,
    write_obj,
    write_pfm,
    write_ply,
    write_ply_mesh,
    write_vtp,
)
from stereo_gpu.types import Mesh


@pytest.fixture
def mesh():
    """A square of 200 x 100 mm, 500 mm before the camera; the texture's corners are red, green, blue and white."""
    texture = np.zeros((5, 7, 3), np.uint8)
    texture[0, 0], texture[0, -1], texture[-1, 0], texture[-1, -1] = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255,) * 3]
    return Mesh(
        vertices=np.array([[0, 0, 500], [200, 0, 500], [0, 100, 500], [200, 100, 510]], np.float32),
        faces=np.array([[0, 2, 3], [0, 3, 1]], np.int32),
        uv=np.array([[0, 0], [1, 0], [0, 1], [1, 1]], np.float32),
        texture=texture,
    )


def glb_parts(path):
    content = path.read_bytes()
    magic, version, length, json_length, kind = struct.unpack_from("<4sIII4s", content)
    assert (magic, version, length, kind) == (b"glTF", 2, len(content), b"JSON")
    document = json.loads(content[20 : 20 + json_length])
    binary_length, kind = struct.unpack_from("<I4s", content, 20 + json_length)
    assert kind == b"BIN\0" and 28 + json_length + binary_length == length
    return document, content[28 + json_length :]


def accessor(document, binary, index):
    entry = document["accessors"][index]
    view = document["bufferViews"][entry["bufferView"]]
    kind = {5126: "<f4", 5125: "<u4", 5123: "<u2"}[entry["componentType"]]
    columns = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[entry["type"]]
    return np.frombuffer(binary, kind, entry["count"] * columns, view["byteOffset"]).reshape(-1, columns)


@pytest.mark.parametrize(
    ("unit", "metres"), [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("in", 0.0254), ("baselines", 1.0)]
)
def test_glb_is_in_metres_with_y_up(tmp_path, mesh, unit, metres):
    mesh = Mesh(vertices=mesh.vertices, faces=mesh.faces, uv=mesh.uv, texture=mesh.texture, unit=unit)
    document, binary = glb_parts(write_glb(tmp_path / "model.glb", mesh))
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    positions = accessor(document, binary, attributes["POSITION"])
    np.testing.assert_allclose(positions, mesh.vertices * np.array([1, -1, -1]) * metres, rtol=1e-6)
    np.testing.assert_array_equal(accessor(document, binary, attributes["TEXCOORD_0"]), mesh.uv)
    np.testing.assert_array_equal(accessor(document, binary, 0).reshape(-1, 3), mesh.faces)
    bounds = document["accessors"][attributes["POSITION"]]
    assert bounds["min"] == positions.min(axis=0).tolist() and bounds["max"] == positions.max(axis=0).tolist()
    assert ("extras" in document["asset"]) == (unit == "baselines")  # whoever measures in such a file is told
    # The viewer looks along -z; what it sees is the front, so normals point to +z.
    a, b, c = positions[mesh.faces[0]]
    assert np.cross(b - a, c - a)[2] > 0
    assert all(view["byteOffset"] % 4 == 0 for view in document["bufferViews"])


def test_glb_holds_the_texture_as_it_is(tmp_path, mesh):
    document, binary = glb_parts(write_glb(tmp_path / "model.glb", mesh))
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    png = np.frombuffer(binary, np.uint8, view["byteLength"], view["byteOffset"])
    np.testing.assert_array_equal(cv2.imdecode(png, cv2.IMREAD_COLOR)[..., ::-1], mesh.texture)
    material = document["materials"][0]
    assert material["extensions"] == {"KHR_materials_unlit": {}}
    assert material["pbrMetallicRoughness"]["metallicFactor"] == 0
    assert document["asset"]["generator"].startswith("stereo-gpu")


def test_models_agree_with_each_other(tmp_path, mesh):
    written = export_model(tmp_path, mesh)
    names = ["model.glb", "model.obj", "model.mtl", "model.png", "model.ply", "surface.vtp"]
    assert [path.name for path in written] == names
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in written)
    glb = trimesh.load_mesh(tmp_path / "model.glb", process=False)
    obj = trimesh.load_mesh(tmp_path / "model.obj", process=False)
    np.testing.assert_allclose(glb.triangles * 1000, obj.triangles, atol=1e-3)
    np.testing.assert_allclose(glb.visual.uv[glb.faces], obj.visual.uv[obj.faces], atol=1e-6)
    assert obj.visual.material.image.size == (7, 5)
    np.testing.assert_array_equal(np.asarray(obj.visual.material.image.convert("RGB")), mesh.texture)


def test_obj_has_its_texture_origin_at_the_bottom_left(tmp_path, mesh):
    lines = write_obj(tmp_path / "cup.obj", mesh)[0].read_text().splitlines()
    assert lines[:2] == ["# stereo-gpu: y up, z towards the viewer, lengths in mm", "mtllib cup.mtl"]
    assert [line for line in lines if line.startswith("v ")][3] == "v 200 -100 -510"
    assert [line for line in lines if line.startswith("vt ")] == ["vt 0 1", "vt 1 1", "vt 0 0", "vt 1 0"]
    assert [line for line in lines if line.startswith("f ")] == ["f 1/1 3/3 4/4", "f 1/1 4/4 2/2"]
    assert "map_Kd cup.png" in (tmp_path / "cup.mtl").read_text()


@pytest.mark.parametrize(
    "name", ["my  cup", "-s 1 cup", " lead", "new\nline", "cup #1", "tab\tcup", "caf\udce9", "x" * 200]
)
def test_obj_names_its_files_in_one_word(tmp_path, mesh, name):
    obj, material, picture = write_obj(tmp_path / f"{name}.obj", mesh)
    assert sorted(tmp_path.iterdir()) == sorted([obj, material, picture])
    assert f"mtllib {material.name}\n" in obj.read_text() and f"map_Kd {picture.name}\n" in material.read_text()
    assert len(material.name.split()) == 1 and not material.name.startswith("-")
    # Nothing is lost where another model has the plain name already.
    again = write_obj(tmp_path / f"{material.stem[:-9]}.obj", mesh)
    assert not {material, picture} & set(again)


def test_models_that_are_named_like_their_picture(tmp_path, mesh):
    with pytest.raises(InputError, match=r"name one that ends in \.obj"):
        write_obj(tmp_path / "cup.png", mesh)
    with pytest.raises(InputError, match=r"name one that ends in \.ply"):
        write_ply_mesh(tmp_path / "cup.PNG", mesh)
    assert not list(tmp_path.iterdir())


def test_files_that_were_there_stay_if_one_cannot_be_written(tmp_path, mesh):
    (tmp_path / "model.png").write_text("old")
    (tmp_path / "model.obj").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        write_obj(tmp_path / "model.obj", mesh)
    with pytest.raises(InputError, match="is a folder"):
        export_model(tmp_path, mesh)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.obj", "model.png"]
    assert (tmp_path / "model.png").read_text() == "old"


def test_vtp_has_arrays_of_the_right_size(tmp_path, mesh):
    root = ElementTree.parse(write_vtp(tmp_path / "surface.vtp", mesh)).getroot()
    assert root.attrib["type"] == "PolyData" and root.attrib["byte_order"] == "LittleEndian"
    piece = root.find("PolyData/Piece")
    assert (piece.attrib["NumberOfPoints"], piece.attrib["NumberOfPolys"]) == ("4", "2")
    arrays = {}
    for array in root.iter("DataArray"):
        data = base64.b64decode(array.text)
        (length,) = struct.unpack_from("<Q", data)
        assert length == len(data) - 8
        kind = {"Float32": "<f4", "UInt8": "u1", "Int32": "<i4"}[array.attrib["type"]]
        columns = int(array.attrib.get("NumberOfComponents", 1))
        arrays[array.attrib["Name"]] = np.frombuffer(data, kind, offset=8).reshape(-1, columns)
    np.testing.assert_array_equal(arrays["Points"], mesh.vertices * np.array([1, -1, -1]))
    np.testing.assert_array_equal(arrays["TextureCoordinates"], [[0, 1], [1, 1], [0, 0], [1, 0]])
    np.testing.assert_array_equal(arrays["Colors"], [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]])
    np.testing.assert_array_equal(arrays["connectivity"].ravel(), mesh.faces.ravel())
    np.testing.assert_array_equal(arrays["offsets"].ravel(), [3, 6])


def test_ply_holds_the_finite_points(tmp_path):
    rng = np.random.default_rng(1)
    points = rng.normal(0, 100, (3, 5, 3)).astype(np.float32)
    colours = rng.integers(0, 256, (3, 5, 3), np.uint8)
    points[1, 2], points[2, 4, 1] = np.nan, np.inf
    cloud = trimesh.load(write_ply(tmp_path / "cloud.ply", points, colours))
    finite = np.isfinite(points).all(axis=-1)
    np.testing.assert_array_equal(cloud.vertices, points[finite] * np.array([1, -1, -1]))
    np.testing.assert_array_equal(cloud.colors[:, :3], colours[finite])
    empty = write_ply(tmp_path / "empty.ply", points * np.float32(np.nan), colours)
    assert b"element vertex 0\n" in empty.read_bytes()
    with pytest.raises(InputError, match="do not fit"):
        write_ply(tmp_path / "wrong.ply", points, colours[:2])
    assert not (tmp_path / "wrong.ply").exists()


def test_pfm_comes_back_and_is_laid_out_as_middlebury_does(tmp_path):
    values = np.array([[1.5, np.nan, -3], [4, 5, 6e5]], np.float32)
    path = write_pfm(tmp_path / "d.pfm", values)
    content = path.read_bytes()
    assert content.startswith(b"Pf\n3 2\n-1.0\n")
    np.testing.assert_array_equal(np.frombuffer(content[-24:], "<f4"), [4, 5, 6e5, 1.5, np.inf, -3])
    np.testing.assert_array_equal(read_pfm(path), values)
    assert read_pfm(path).dtype == np.float32
    np.testing.assert_array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[1], values[1])


def test_pfm_of_the_other_byte_order(tmp_path):
    path = tmp_path / "big.pfm"
    path.write_bytes(b"Pf\n2 1\n1.0\n" + np.array([10, 0.25], ">f4").tobytes())
    np.testing.assert_array_equal(read_pfm(path), [[10, 0.25]])


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"Pf\n3 2\n-1.0\n" + bytes(23), "is cut off: 3 x 2 values need 24 bytes, it has 23"),
        (b"PF\n1 1\n-1.0\n" + bytes(12), "not a PFM of one channel"),
        (b"Pf\n-1 2\n-1.0\n", "not a PFM of one channel"),
        (b"\x89PNG\r\n\x1a\n", "is not a PFM"),
        (b"", "is not a PFM"),
    ],
)
def test_broken_pfm(tmp_path, content, reason):
    path = tmp_path / "broken.pfm"
    path.write_bytes(content)
    with pytest.raises(InputError, match=reason):
        read_pfm(path)


def test_pfm_that_is_missing_or_has_colours(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_pfm(tmp_path / "none.pfm")
    with pytest.raises(InputError, match="pass one channel"):
        write_pfm(tmp_path / "d.pfm", np.zeros((2, 2, 3), np.float32))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"unit": "furlong"}, "unknown unit 'furlong'"),
        ({"uv": np.zeros((3, 2), np.float32)}, "uv of a mesh has shape"),
        ({"vertices": np.full((4, 3), np.nan, np.float32)}, "not finite"),
        ({"faces": np.array([[0, 1, 4]], np.int32)}, "faces name vertices"),
        ({"faces": np.zeros((0, 3), np.int32)}, "0 faces"),
        ({"texture": np.zeros((4, 4), np.uint8)}, "the texture is"),
    ],
)
def test_meshes_that_no_file_could_hold(tmp_path, mesh, change, reason):
    parts = {name: getattr(mesh, name) for name in ("vertices", "faces", "uv", "texture", "unit")}
    with pytest.raises(InputError, match=reason):
        export_model(tmp_path, Mesh(**(parts | change)))
    assert not list(tmp_path.iterdir())


def test_folder_that_is_missing(tmp_path, mesh):
    with pytest.raises(InputError, match="no folder"):
        export_model(tmp_path / "nowhere", mesh)
    assert not list(tmp_path.iterdir())
