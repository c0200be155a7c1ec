"""Every model file as another program reads it: an F on a leaning board is in its place, upright, not mirrored.

Each program looks its colours up itself, or by its own rule of where a texture begins; where a picture can be drawn
without a screen, VTK draws the files as ParaView would.
"""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import missing

from stereo_gpu.export import export_model, write_glb, write_ply
from stereo_gpu.types import Mesh

F = """
..........
.#######..
.########.
.##.......
.##.......
.######...
.######...
.##.......
.##.......
.##.......
.##.......
..........
..........
"""
LETTER = np.array([[letter == "#" for letter in line] for line in F.split()])
ROWS, COLUMNS = LETTER.shape
PAPER, INK = (240, 230, 40), (20, 60, 200)
STEP = 10.0  # mm between vertices


@pytest.fixture(scope="module")
def board():
    """The letter as the left camera would see it: one vertex in the middle of each texel, the right side farther."""
    x, y = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    vertices = np.stack([(x + 3) * STEP, (y - 4) * STEP, 500 + 2 * x + y], axis=2)
    corner = (x + COLUMNS * y)[:-1, :-1].ravel()
    quads = np.stack([corner, corner + COLUMNS, corner + COLUMNS + 1, corner + 1], axis=1)
    return Mesh(
        vertices=vertices.reshape(-1, 3).astype(np.float32),
        faces=np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32),
        uv=np.stack([(x + 0.5) / COLUMNS, (y + 0.5) / ROWS], axis=2).reshape(-1, 2).astype(np.float32),
        texture=np.where(LETTER[..., None], np.uint8(INK), np.uint8(PAPER)),
    )


@pytest.fixture(scope="module")
def folder(board, tmp_path_factory):
    """The board in every format, in a folder and under names that people use."""
    folder = tmp_path_factory.mktemp("a model é")
    export_model(folder, board)
    for form in ("jpeg", "webp"):
        write_glb(folder / f"{form}.glb", board, texture_format=form, quality=100)
    write_ply(folder / "cloud.ply", board.vertices.reshape(ROWS, COLUMNS, 3), board.texture)
    return folder


@pytest.fixture(scope="module")
def vtk():
    """VTK's modules by name, so that none that draws is loaded."""
    if importlib.util.find_spec("vtkmodules") is None:
        missing("vtk", "not installed; pip install vtk")
    return lambda module: importlib.import_module(f"vtkmodules.{module}")


def assert_reads_f(points, colours, mm=1.0, tolerance=0):
    """Points in a viewer's axes, y up and z towards the viewer, and the colours that a program gives them."""
    points, colours = np.asarray(points) / mm, np.asarray(colours)[:, :3].astype(int)
    column, row = np.round(points[:, 0] / STEP - 3).astype(int), np.round(-points[:, 1] / STEP + 4).astype(int)
    np.testing.assert_allclose(points[:, 2], -(500 + 2 * column + row), rtol=1e-5)
    read = np.full((ROWS, COLUMNS, 3), -1)
    read[row, column] = colours
    ink = np.abs(read - INK).max(axis=2) <= tolerance
    paper = np.abs(read - PAPER).max(axis=2) <= tolerance
    np.testing.assert_array_equal(ink, LETTER)
    np.testing.assert_array_equal(paper, ~LETTER)


def test_an_f_is_not_its_own_mirror_image():
    for turned in (LETTER[::-1], LETTER[:, ::-1], LETTER[::-1, ::-1]):
        assert (turned != LETTER).any()


@pytest.mark.parametrize(
    ("name", "metres", "tolerance"),
    [
        ("model.glb", 1e-3, 0),
        ("jpeg.glb", 1e-3, 8),
        ("webp.glb", 1e-3, 0),
        ("model.obj", 1.0, 0),
        ("model.ply", 1.0, 0),
    ],
)
def test_trimesh_reads_the_letter(folder, board, name, metres, tolerance):
    model = trimesh.load_mesh(folder / name, process=False)
    colours = model.visual.to_color().vertex_colors
    assert_reads_f(model.vertices, colours, metres, tolerance)
    # The faces that we see are those that it sees: their normals point at the viewer.
    assert (model.face_normals[:, 2] > 0).all() and len(model.faces) == len(board.faces)


def test_trimesh_starts_at_our_camera(board, tmp_path):
    from stereo_gpu.model_files.gltf import Standpoint

    camera = Standpoint(name="right camera", right=120.0, half_width=0.5, half_height=0.4)
    scene = trimesh.load_scene(write_glb(tmp_path / "model.glb", board, camera=camera))
    assert scene.has_camera
    np.testing.assert_allclose(scene.camera_transform, trimesh.transformations.translation_matrix([0.12, 0, 0]))
    np.testing.assert_allclose(scene.camera.fov[1], 2 * np.degrees(np.arctan(0.4)))


def test_trimesh_reads_the_cloud(folder):
    cloud = trimesh.load(folder / "cloud.ply")
    assert_reads_f(cloud.vertices, cloud.colors)


def test_vtk_reads_the_cloud(folder, vtk):
    reader = vtk("vtkIOPLY").vtkPLYReader()
    reader.SetFileName(str(folder / "cloud.ply"))
    assert_reads_f(points_of(reader, vtk)[0], arrays(reader, vtk)["RGB"])


def test_vtk_reads_the_letter_from_vtp(folder, board, vtk):
    reader = vtk("vtkIOXML").vtkXMLPolyDataReader()
    reader.SetFileName(str(folder / "surface.vtp"))
    points, uv, faces = points_of(reader, vtk)
    assert_reads_f(points, arrays(reader, vtk)["Colors"])
    assert_reads_f(points, texels(folder / "model.png", uv, vtk))
    np.testing.assert_array_equal(faces, board.faces)


@pytest.mark.parametrize(
    ("module", "kind", "name"),
    [("vtkIOGeometry", "vtkOBJReader", "model.obj"), ("vtkIOPLY", "vtkPLYReader", "model.ply")],
)
def test_vtk_reads_the_letter_from_obj_and_ply(folder, board, vtk, module, kind, name):
    reader = getattr(vtk(module), kind)()
    reader.SetFileName(str(folder / name))
    points, uv, faces = points_of(reader, vtk)
    assert_reads_f(points, texels(folder / "model.png", uv, vtk))
    assert len(faces) == len(board.faces)


def points_of(reader, vtk):
    """Points, texture coordinates and triangles as VTK holds them."""
    to_numpy = vtk("util.numpy_support").vtk_to_numpy
    reader.Update()
    data = reader.GetOutput()
    uv = data.GetPointData().GetTCoords()
    faces = to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return to_numpy(data.GetPoints().GetData()), None if uv is None else to_numpy(uv), faces


def arrays(reader, vtk):
    """What VTK holds at each point, by name."""
    held = reader.GetOutput().GetPointData()
    to_numpy = vtk("util.numpy_support").vtk_to_numpy
    return {held.GetArrayName(index): to_numpy(held.GetArray(index)) for index in range(held.GetNumberOfArrays())}


def texels(path, uv, vtk):
    """VTK's texture coordinates count from the first row of its picture, which is the lowest one."""
    reader = vtk("vtkIOImage").vtkPNGReader()
    reader.SetFileName(str(path))
    reader.Update()
    picture = reader.GetOutput()
    width, height, _ = picture.GetDimensions()
    values = vtk("util.numpy_support").vtk_to_numpy(picture.GetPointData().GetScalars()).reshape(height, width, -1)
    where = np.floor(uv * [width, height]).astype(int)
    return values[where[:, 1], where[:, 0]]


def draw(*arguments):
    """A picture by VTK, in a process of its own: without a driver for OpenGL, VTK may end it."""
    script = Path(__file__).with_name("draw_with_vtk.py")
    done = subprocess.run([sys.executable, script, *arguments], capture_output=True, text=True, timeout=100)
    return done, arguments[-1]


@pytest.fixture(scope="module")
def opengl(vtk, tmp_path_factory):
    """Drawing without a screen."""
    done, out = draw(tmp_path_factory.mktemp("empty") / "empty.json")
    drawn = json.loads(out.read_text()) if not done.returncode and out.exists() else [[None]]
    if drawn[0][0] != [255, 0, 0]:
        missing("opengl", f"VTK cannot draw here: {done.stderr.strip()[-200:] or done.returncode}")


@pytest.mark.parametrize("name", ["model.glb", "jpeg.glb", "model.obj", "model.ply", "surface.vtp"])
def test_vtk_draws_the_letter(folder, opengl, name, tmp_path):
    done, out = draw(folder / name, folder / "model.png", tmp_path / "drawn.json")
    assert done.returncode == 0, done.stderr
    drawn = np.array(json.loads(out.read_text()))
    # The outermost vertices lie on the border itself. Ink is blue and paper yellow, whatever light VTK puts on them.
    drawn, letter = drawn[1:-1, 1:-1], LETTER[1:-1, 1:-1]
    np.testing.assert_array_equal(drawn[..., 2] > drawn[..., 0], letter)
    assert (drawn[~letter][:, 1] > 60).all()  # paper, not the red behind
