import numpy as np
import pytest
from surfaces import CENTRE, ball, from_ball, normals, plane, seen, signed_areas, triangulated

from stereo_gpu.errors import InputError
from stereo_gpu.fairing import fair
from stereo_gpu.mesh import build_mesh
from stereo_gpu.types import Surface


@pytest.fixture(scope="module")
def cap():
    """The front of a ball, at steps of about 2 mm."""
    depth = ball(wall=np.nan)
    depth[depth > 860] = np.nan  # no steep rim, where a pixel's noise is larger than its triangles
    return build_mesh(*triangulated(depth), method="dense", centre=CENTRE)


def noisy(surface, size, seed=1):
    """Noise along the line of sight, as disparity has it."""
    rng = np.random.default_rng(seed)
    return Surface(
        vertices=(surface.vertices * (1 + rng.normal(0, size, (len(surface.vertices), 1)))).astype(np.float32),
        faces=surface.faces,
    )


def roughness(surface):
    """Mean angle between a face and a ball's surface under it, degrees."""
    middle = surface.vertices[surface.faces].mean(axis=1) - (*CENTRE[:2], 900)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    cosine = (normals(surface.vertices, surface.faces) * middle).sum(axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean()


def test_noise_goes_and_the_radius_stays(cap):
    rough = noisy(cap, 5e-4)
    smooth = fair(rough, iterations=20, centre=CENTRE)
    assert roughness(smooth) < roughness(rough) / 4
    assert from_ball(smooth.vertices).mean() == pytest.approx(100, abs=0.1)
    assert from_ball(smooth.vertices).std() < from_ball(rough.vertices).std() / 2
    np.testing.assert_array_equal(smooth.faces, rough.faces)


def test_size_stays_over_many_iterations(cap):
    smooth = fair(cap, iterations=200, centre=CENTRE)
    before, after = (np.ptp(s.vertices, axis=0) for s in (cap, smooth))
    np.testing.assert_allclose(after, before, rtol=0.03)
    assert from_ball(smooth.vertices).mean() == pytest.approx(100, abs=0.5)


def test_plane_stays_flat_and_keeps_its_border():
    surface = build_mesh(*triangulated(plane()), method="dense", centre=CENTRE)
    smooth = fair(surface, iterations=10, centre=CENTRE)
    direction = normals(surface.vertices, surface.faces).mean(axis=0)
    np.testing.assert_allclose(smooth.vertices @ direction, surface.vertices @ direction, atol=0.01)
    areas = [signed_areas(seen(s.vertices), s.faces).sum() for s in (surface, smooth)]
    assert areas[1] == pytest.approx(areas[0], rel=0.01)


def test_it_is_the_formula():
    rng = np.random.default_rng(5)
    surface = build_mesh(*triangulated(plane(7, 9)), method="dense", smallest_part=0, centre=CENTRE)
    surface = Surface(
        vertices=surface.vertices + rng.normal(0, 0.1, surface.vertices.shape).astype(np.float32), faces=surface.faces
    )
    edges = {}
    for face in surface.faces.tolist():
        for a, b in ((0, 1), (1, 2), (2, 0)):
            edge = frozenset((face[a], face[b]))
            edges[edge] = edges.get(edge, 0) + 1
    border = {edge for edge, count in edges.items() if count == 1}
    on_border = set().union(*border)
    expected = surface.vertices.astype(float)
    for _ in range(3):
        for step in (0.5, -1 / (1 / 0.5 - 0.1)):
            moved = expected.copy()
            for vertex in range(len(expected)):
                pulling = border if vertex in on_border else edges
                others = [next(iter(edge - {vertex})) for edge in pulling if vertex in edge]
                moved[vertex] += step * (expected[others].mean(axis=0) - expected[vertex])
            expected = moved
    np.testing.assert_allclose(fair(surface, iterations=3, centre=CENTRE).vertices, expected, atol=1e-3)


def test_no_triangle_turns_its_back(cap):
    rough = noisy(cap, 3e-3)
    front = signed_areas(seen(rough.vertices), rough.faces) < 0
    smooth = fair(rough, iterations=10, centre=CENTRE)
    area = signed_areas(seen(smooth.vertices), smooth.faces)
    assert area[front].max() < 1e-3


def test_a_lone_triangle_and_no_iterations(cap):
    assert fair(cap, iterations=0) is cap
    lone = Surface(vertices=np.eye(3, dtype=np.float32) + 5, faces=np.array([[0, 1, 2]], np.int32))
    assert np.isfinite(fair(lone).vertices).all()


@pytest.mark.parametrize("option", [{"iterations": -1}, {"forward": 1.0}, {"forward": 0.9, "pass_band": 0.2}])
def test_options_out_of_range(cap, option):
    with pytest.raises(InputError, match=next(iter(option))):
        fair(cap, **option)
