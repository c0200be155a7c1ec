import base64
import io
import json
import logging
import re

import numpy as np
import pytest
import trimesh

from stereo_gpu import viewer
from stereo_gpu.errors import StageError
from stereo_gpu.types import Mesh
from stereo_gpu.viewer import viewer_page


def wall(depth=2000.0, side=64, unit="mm"):
    """A wall of 400 x 300, `depth` away: red, green, blue and yellow quarters."""
    x, y = np.meshgrid(np.linspace(-100, 300, 9), np.linspace(-150, 150, 7))
    vertices = np.stack([x, y, np.full_like(x, depth)], -1).reshape(-1, 3).astype(np.float32)
    uv = np.stack([(x + 100) / 400, (y + 150) / 300], -1).reshape(-1, 2).astype(np.float32)
    index = np.arange(63).reshape(7, 9)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)
    texture = np.zeros((side, side, 3), np.uint8)
    texture[: side // 2, : side // 2] = (255, 0, 0)
    texture[: side // 2, side // 2 :] = (0, 255, 0)
    texture[side // 2 :, : side // 2] = (0, 0, 255)
    texture[side // 2 :, side // 2 :] = (255, 255, 0)
    return Mesh(vertices=vertices, faces=faces.astype(np.int32), uv=uv, texture=texture, unit=unit)


def parts(page):
    glb = re.search(r'const glb="([^"]+)";', page)
    stage = re.search(r"const stage=(\{.*\});", page)
    assert glb and stage, "the page does not carry our own stage: has trimesh's viewer changed?"
    scene = trimesh.load(io.BytesIO(base64.b64decode(glb.group(1))), file_type="glb")
    return next(iter(scene.geometry.values())), json.loads(stage.group(1))


def test_model_is_in_metres_y_up_and_facing_the_viewer():
    model, _ = parts(viewer_page(wall()))
    np.testing.assert_allclose(model.bounds, [[-0.1, -0.15, -2.0], [0.3, 0.15, -2.0]], atol=1e-6)
    assert (model.face_normals[:, 2] > 0.99).all()


def test_texture_is_upright_and_packed_as_jpeg():
    model, _ = parts(viewer_page(wall()))
    picture = model.visual.material.baseColorTexture
    assert picture.format == "JPEG"
    corner = np.argmin(model.vertices @ [1, -1, 0])  # top left
    u, v = model.visual.uv[corner]  # trimesh counts from the bottom left
    at = (round(u * (picture.width - 1)), round((1 - v) * (picture.height - 1)))
    assert at == (0, 0)
    np.testing.assert_allclose(picture.getpixel(at), (255, 0, 0), atol=12)


def test_large_textures_are_shrunk():
    model, _ = parts(viewer_page(wall(side=2500)))
    assert model.visual.material.baseColorTexture.size == (2048, 2048)


@pytest.mark.parametrize(("unit", "scale"), [("mm", 0.001), ("m", 1.0)])
def test_first_view_looks_at_the_middle_and_holds_the_model(unit, scale):
    _, stage = parts(viewer_page(wall(unit=unit)))
    assert stage["depth"] == pytest.approx(2000 * scale)
    np.testing.assert_allclose(stage["target"], np.array([100, 0, -2000]) * scale, atol=12 * scale)
    assert 0.1 <= stage["halfWidth"] < 0.13
    assert 0.075 <= stage["halfHeight"] < 0.1


def test_page_loads_nothing():
    page = viewer_page(wall())
    assert not re.findall(r"<(?:script|link|img|iframe)[^>]+(?:src|href)=", page)


def test_without_webgl_the_page_points_to_a_picture_of_the_report():
    # tests/test_pipeline.py asks that the report has a picture of this name.
    assert "“Turned” below shows it" in viewer_page(wall())


def test_a_changed_trimesh_still_gives_a_page(monkeypatch, caplog):
    monkeypatch.setattr(viewer, "_TEMPLATE", ("elsewhere.zip",))
    with caplog.at_level(logging.WARNING):
        page = viewer_page(wall())
    assert "base64_data" in page and page.rstrip().endswith("</html>") and "const glb" not in page
    assert "has changed" in caplog.text


def test_nothing_to_show():
    mesh = wall()
    empty = Mesh(vertices=mesh.vertices, faces=np.empty((0, 3), np.int32), uv=mesh.uv, texture=mesh.texture, unit="mm")
    with pytest.raises(StageError, match="none of 0 faces"):
        viewer_page(empty)
