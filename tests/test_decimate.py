from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from surfaces import CENTRE, ball, from_ball, plane, seen, signed_areas, triangulated

from stereo_gpu.decimate import decimate
from stereo_gpu.errors import InputError, StageError
from stereo_gpu.mesh import build_mesh
from stereo_gpu.types import Surface


@pytest.fixture(scope="module")
def scene():
    return build_mesh(*triangulated(ball()), method="dense", centre=CENTRE)


def test_shape_borders_and_direction_stay(scene):
    small = decimate(scene, 2000, centre=CENTRE)
    assert 1800 < len(small.faces) <= 2000
    assert small.vertices.dtype == np.float32 and small.faces.dtype == np.int32
    assert len(np.unique(small.faces)) == len(small.vertices)
    assert (np.diff(np.sort(small.faces, axis=1), axis=1) > 0).all()
    area = signed_areas(seen(small.vertices), small.faces)
    assert (area < 0).all()
    whole = signed_areas(seen(scene.vertices), scene.faces).sum()
    assert area.sum() == pytest.approx(whole, rel=0.01)  # borders are neither eaten nor bridged
    on_ball = small.vertices[:, 2] < 1200
    # Quadrics put corners outside of a ball, by about as much as its facets cut into it.
    np.testing.assert_allclose(from_ball(small.vertices[on_ball]), 100, atol=1.5)
    np.testing.assert_allclose(small.vertices[~on_ball][:, 2], 1500, atol=0.01)


def test_plane_keeps_its_outline():
    surface = build_mesh(*triangulated(plane()), method="dense", centre=CENTRE)
    small = decimate(surface, 100, centre=CENTRE)
    assert len(small.faces) <= 100
    before, after = seen(surface.vertices), seen(small.vertices)
    np.testing.assert_allclose(after.min(axis=0), before.min(axis=0), atol=0.6)
    np.testing.assert_allclose(after.max(axis=0), before.max(axis=0), atol=0.6)
    # The error of a plane is 0 along its border too, so that fifty triangles into one may cut a corner.
    whole = signed_areas(before, surface.faces).sum()
    assert signed_areas(after, small.faces).sum() == pytest.approx(whole, rel=0.04)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_unit_does_not_matter(scene, scale):
    scaled = Surface(vertices=scene.vertices * np.float32(scale), faces=scene.faces)
    small = decimate(scaled, 2000, centre=(CENTRE[0] * scale, 0, 0))
    same = decimate(scene, 2000, centre=CENTRE)
    assert abs(len(small.faces) - len(same.faces)) < 20
    on_ball = small.vertices[:, 2] < 1200 * scale
    np.testing.assert_allclose(from_ball(small.vertices[on_ball] / scale), 100, atol=1.5)


def test_threads_do_not_mix_their_meshes(scene):
    flat = build_mesh(*triangulated(plane(90, 90)), method="dense", centre=CENTRE)
    jobs = [scene, flat] * 3
    alone = [decimate(job, 3000, centre=CENTRE) for job in jobs[:2]] * 3
    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(lambda job: decimate(job, 3000, centre=CENTRE), jobs))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one.faces, other.faces)
        np.testing.assert_array_equal(one.vertices, other.vertices)


def test_small_meshes_stay_as_they_are(scene):
    assert decimate(scene, len(scene.faces)) is scene


def test_what_cannot_be_decimated(scene):
    with pytest.raises(InputError, match="target_faces is 0"):
        decimate(scene, 0)
    with pytest.raises(InputError, match="relief is 0"):
        decimate(scene, 10, relief=0)
    broken = Surface(vertices=scene.vertices - np.float32(1e4), faces=scene.faces)
    with pytest.raises(StageError, match="not before the camera"):
        decimate(broken, 10)
